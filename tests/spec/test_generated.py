"""The validator on generated data: nothing to find, and what is broken is found."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.spec.dataset import Dataset
from pliant.spec.sequence import SequenceRecord
from pliant.spec.validation.validate import validate
from tests.conformance.edits import listed


def test_a_generated_set_is_valid(tiny_dataset: Path) -> None:
    report = validate(tiny_dataset)
    assert [str(issue) for issue in report.issues] == []
    assert report.frames == 30


def test_a_generated_episode_is_valid(tiny_episode: Path) -> None:
    assert [str(issue) for issue in validate(tiny_episode).issues] == []


def one_sequence(tiny_dataset: Path, tier: str, tmp_path: Path) -> tuple[Path, SequenceRecord]:
    """Copy the set without the queries, whose truth would tell on any change."""
    root = tmp_path / "set"
    shutil.copytree(tiny_dataset, root, ignore=shutil.ignore_patterns("queries", "truth", ".*"))
    return root, next(s for s in Dataset.open(root).sequences if s.tier == tier)


@pytest.mark.parametrize("tier", ["rope", "cloth-1", "cloth-3"])
def test_swapped_depth_images_are_found(tiny_dataset: Path, tier: str, tmp_path: Path) -> None:
    root, sequence = one_sequence(tiny_dataset, tier, tmp_path)
    first, second = (sequence.dir / f"depth/{frame:06d}.exr" for frame in (0, 1))
    first.rename(first.with_name("x"))
    second.rename(first)
    first.with_name("x").rename(second)
    listed()(root)
    assert "VISIBLE_DISAGREES" in validate(root).counts


@pytest.mark.parametrize("tier", ["rope", "cloth-1", "cloth-3"])
def test_hidden_points_called_visible_are_found(
    tiny_dataset: Path, tier: str, tmp_path: Path
) -> None:
    root, sequence = one_sequence(tiny_dataset, tier, tmp_path)
    path = sequence.dir / "correspondences.parquet"
    table = pq.read_table(path)
    states = np.array(table.column("visibility").to_pylist())
    assert (states == "self_occluded").any()
    states[states == "self_occluded"] = "visible"
    index = table.column_names.index("visibility")
    column = pa.array(states.tolist(), pa.string())
    pq.write_table(table.set_column(index, table.schema.field(index), column), path)
    listed()(root)
    # At this size the rope is three pixels wide: no place on it is smooth, and the sum tells.
    expected = (
        {"SUMMARY_DISAGREES"} if tier == "rope" else {"SUMMARY_DISAGREES", "VISIBLE_DISAGREES"}
    )
    assert expected <= set(validate(root).counts)
