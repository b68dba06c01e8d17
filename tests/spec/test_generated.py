"""The validator on generated data: nothing to find, and what is broken is found."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from pliant.spec.validation.validate import validate
from tests.conformance.steps import perform


def test_a_generated_episode_is_valid(tiny_episode: Path) -> None:
    assert [str(issue) for issue in validate(tiny_episode).issues] == []


SWAPPED = {"swap": "depth/000000.exr", "other": "depth/000001.exr"}
CALLED_VISIBLE = {
    "rows": "correspondences.parquet",
    "where": {"visibility": "self_occluded"},
    "set": {"each.visibility": "visible"},
}


@pytest.mark.parametrize("tier", ["rope", "cloth-1", "cloth-3"])
@pytest.mark.parametrize("step", [SWAPPED, CALLED_VISIBLE], ids=["swapped", "called-visible"])
def test_what_is_broken_is_found(
    tiny_dataset: Path, tier: str, step: dict[str, Any], tmp_path: Path
) -> None:
    """Without the queries, whose truth would tell on any change."""
    ignored = shutil.ignore_patterns("queries", "truth", ".*")
    root = Path(shutil.copytree(tiny_dataset, tmp_path / "set", ignore=ignored))
    perform(next(root.glob(f"sequences/{tier}/*")), [step])
    perform(root, [{"relist": "sequences"}])
    # At this size the rope is three pixels wide: no place on it is smooth, and the sum tells.
    thin = tier == "rope" and step is CALLED_VISIBLE
    code = "SUMMARY_DISAGREES" if thin else "VISIBLE_DISAGREES"
    assert code in validate(root).counts
