"""A split is walked in blocks of whole pairs: their size changes no figure; what is refused."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.evaluator import evaluate, scoring
from pliant.evaluator.metrics import blocks
from pliant.evaluator.metrics.base import Metric
from pliant.evaluator.metrics.blocks import Block, read_blocks, read_tables
from pliant.evaluator.submission.answers import PlacedAnswers
from pliant.evaluator.submission.queries import Queries
from pliant.spec.errors import SpecError
from pliant.spec.io.parquet import write_table
from pliant.spec.opening import check_truth
from pliant.spec.tables import TRUTH
from tests.evaluator.figures import assert_same
from tests.evaluator.hand_made import Split, off_by, split
from tests.evaluator.references import answers_of

NAN = math.nan


@pytest.mark.parametrize("kind", ["sigma", "holes"])
def test_a_block_for_each_pair_gives_the_figures_of_one_block(
    kind: str, scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = answers_of(scene, 3, kind)
    path = scene.submit(tmp_path / "s.parquet", table)
    whole = evaluate(path, scene.root, allow_missing=True)
    assert sum(whole.per_pair["answered"].to_pylist()) == table.num_rows
    assert not {"geodesic", "causes"} & set(whole.document["notes"])  # no pair is left out
    monkeypatch.setattr(scoring, "_PAIRS_WITH_IMAGES", 1)
    split = evaluate(path, scene.root, allow_missing=True)
    for name in ("overall", "tiers", "curves", "slices", "causes"):
        # The last digits of sums depend on the order of their terms.
        assert_same(split.document[name], whole.document[name], name, 1e-12)
    assert split.per_pair.equals(whole.per_pair)


def test_memory_does_not_grow_with_row_groups(scene_maker: Any, tmp_path: Path) -> None:
    """Python's own allocations for 20,000 rows stay near what the stored arrays take."""
    scene = scene_maker(
        tmp_path / "data", sequences=50, frames=3, queries=100, images=False, tiers=("cloth",)
    )
    path = scene.submit(tmp_path / "s.parquet")
    evaluate(path, scene.root, protocol="paper")
    tracemalloc.start()
    evaluate(path, scene.root, protocol="paper")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6


def test_a_metric_says_itself_what_it_takes_in() -> None:
    made = Split(split([1]), off_by(0))
    with pytest.raises(NotImplementedError):
        Metric[Any](None, made.context).update(made.block(0, 1))


def place(u: float, visibility: str = "visible") -> dict[str, Any]:
    return {"u": u, "v": u + 0.5, "visibility": visibility}


def written(folder: Path, **columns: Any) -> tuple[Queries, Path]:
    """Write three pairs of 2, 1 and 2 queries, and their truth in groups of two rows."""
    asked = {"u_a": [1, 2, 3, 4, 5], "v_a": [6, 7, 8, 9, 10]}
    queries = split([2, 1, 2], path=folder / "queries.parquet")
    pq.write_table(pa.table(asked), queries.path)
    true = {
        "pair_id": [0, 0, 1, 2, 2], "query_id": [0, 1, 0, 0, 1],
        "u_b": [10, 10, 10, 10, NAN], "v_b": [10, 10, 10, 10, NAN],
        "visibility_b": ["visible", "visible", "visible", "visible", "self_occluded"],
        "alternatives": [[], [place(1)], [place(2)], [place(3, "occluded"), place(4)], []],
    }  # fmt: skip
    path = folder / "truth.parquet"
    pq.write_table(pa.table(true | columns), path, row_group_size=2)
    return queries, path


ANSWERS = np.concatenate([off_by(3, 0, 500, 4), [[700, 10]]])


def read(queries: Queries, truth: Path, rows: int | None = None, **more: Any) -> list[Block]:
    """Read the blocks of `ANSWERS`."""
    tables = read_tables(queries, truth, ["alternatives"])
    return list(read_blocks(queries, tables, PlacedAnswers(ANSWERS, answered=5), rows, **more))


def test_errors_of_visible_points_are_capped(tmp_path: Path) -> None:
    (block,) = read(*written(tmp_path), cap_errors=True)
    np.testing.assert_array_equal(block.answer_px, [*off_by(3, 0, 50, 4), [700, 10]])
    # A length that is the bound stays as it is, to the last bit.
    answer = np.array([[0.1, 0.7]])
    true = np.array([[100.3, 4.9]])
    assert (true + (answer - true) != answer).any()
    length = np.hypot(*(answer - true).T)[0]
    same = blocks._capped(answer, true, np.array([True]), length)
    assert (same == answer).all()


@pytest.mark.parametrize(
    ("sequences", "block_rows", "ends"),
    [
        ([0, 0, 0], 3, [2, 3]),  # longer than a block: ends after whole pairs
        ([0, 1, 1], 3, [1, 3]),
        ([0, 0, 1], 4, [2, 3]),
        ([0, 1, 2], 3, [2, 3]),
        ([0, 1, 1], 1, [1, 2, 3]),
        ([0, 1, 2], 5, [3]),
    ],
)
def test_a_target_sequence_is_in_one_block_if_it_fits(
    sequences: list[int], block_rows: int, ends: list[int], tmp_path: Path
) -> None:
    queries, truth = written(tmp_path)
    found = read(replace(queries, sequence_b=np.array(sequences, np.int32)), truth, block_rows)
    assert [block.pairs.stop for block in found] == ends
    assert [block.pairs.start for block in found] == [0, *ends[:-1]]
    np.testing.assert_array_equal(np.concatenate([each.answer_px for each in found]), ANSWERS)
    partners: list[Any] = [each.partners for each in found]
    counts = np.concatenate([np.diff(each.begin) for each in partners])
    np.testing.assert_array_equal(counts, [0, 1, 1, 2, 0])
    places = np.concatenate([each.uv_px for each in partners])
    np.testing.assert_array_equal(places, [[1, 1.5], [2, 2.5], [3, 3.5], [4, 4.5]])
    visible = np.concatenate([each.visible for each in partners])
    assert visible.tolist() == [True, True, False, True]


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"pair_id": [0, 0, 1, 1, 2]}, "other keys in rows 3 to 5"),
        ({"query_id": [0, 1, 0, 1, 0]}, "other keys in rows 3 to 5"),
        ({"query_id": [0, 2, 0, 0, 1]}, "other keys in rows 0 to 3"),
        ({"visibility_b": ["visible"] * 4 + ["seen"]}, "an unknown visibility state"),
        ({"u_b": [10, 10, 10, NAN, NAN]}, "a visible point has no finite position"),
        ({"v_b": [10, 10, 10, math.inf, NAN]}, "a visible point has no finite position"),
    ],
)
def test_a_truth_that_is_refused(columns: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=said):
        read(*written(tmp_path, **columns), 3)


def test_a_truth_of_more_rows_is_refused(tmp_path: Path) -> None:
    queries, truth = written(tmp_path)
    longer = pq.read_table(truth)
    pq.write_table(pa.concat_tables([longer, longer.slice(4)]), truth)
    with pytest.raises(SpecError, match="6 rows; required: 5 rows"):
        read(queries, truth)


@pytest.mark.parametrize("wrong", ["dataset_id", "dataset_version", "split", "sha"])
def test_a_truth_of_something_else_is_refused(wrong: str, tmp_path: Path) -> None:
    path = tmp_path / "truth.parquet"
    right = {"dataset_id": "d", "dataset_version": "1.0.0", "split": "test", "sha": "0" * 64}
    footer = {"dataset": {"id": "d", "version": "1.0.0"}, "split": "test"}
    write_table(path, TRUTH.empty_table(), "truth", {**footer, "queries_sha256": "0" * 64})
    check_truth(path, **right)
    with pytest.raises(SpecError, match="the truth does not belong to these queries"):
        check_truth(path, **right | {wrong: "f" * 64})
    with pytest.raises(SpecError, match="was not found"):
        check_truth(tmp_path, **right)
