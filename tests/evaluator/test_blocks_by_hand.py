"""Blocks that are read from a small truth, and what is refused of a truth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.evaluator.metrics import blocks
from pliant.evaluator.metrics.base import Metric
from pliant.evaluator.metrics.blocks import read_blocks, read_tables
from pliant.evaluator.submission.answers import PlacedAnswers
from pliant.evaluator.submission.queries import Queries
from pliant.spec.errors import SpecError
from pliant.spec.io.parquet import write_table
from pliant.spec.opening import check_truth
from pliant.spec.tables import TRUTH
from tests.evaluator.hand_made import Split, off_by, split

NAN = math.nan


def test_a_metric_says_itself_what_it_takes_in() -> None:
    made = Split(split([1]), off_by(0))
    with pytest.raises(NotImplementedError):
        Metric[Any](None, made.context).update(made.block(0, 1))


def written(folder: Path, **columns: Any) -> tuple[Queries, Path]:
    """Write three pairs of 2, 1 and 2 queries, and their truth."""
    asked = {"u_a": [1, 2, 3, 4, 5], "v_a": [6, 7, 8, 9, 10]}
    queries = split([2, 1, 2], path=folder / "queries.parquet")
    pq.write_table(pa.table(asked), queries.path)
    place = {"u": 1.0, "v": 2.0, "visibility": "visible"}
    true = {
        "pair_id": [0, 0, 1, 2, 2], "query_id": [0, 1, 0, 0, 1],
        "u_b": [10, 10, 10, 10, NAN], "v_b": [10, 10, 10, 10, NAN],
        "visibility_b": ["visible", "visible", "visible", "visible", "self_occluded"],
        "point": [7, 8, 9, 10, 11], "box_px": [20, 21, 22, 23, 24],
        "alternatives": [[], [place], [], [place, place], []],
    }  # fmt: skip
    path = folder / "truth.parquet"
    pq.write_table(pa.table(true | columns), path)
    return queries, path


ANSWERS = np.concatenate([off_by(3, 0, 500, 4), [[700, 10]]])


def test_errors_of_visible_points_are_capped(tmp_path: Path) -> None:
    queries, truth = written(tmp_path)
    (block,) = read_blocks(
        queries, read_tables(queries, truth), PlacedAnswers(ANSWERS, answered=5), cap_errors=True
    )
    np.testing.assert_array_equal(block.answer_px, [*off_by(3, 0, 50, 4), [700, 10]])
    (block,) = read_blocks(queries, read_tables(queries, truth), PlacedAnswers(ANSWERS, answered=5))
    np.testing.assert_array_equal(block.answer_px, ANSWERS)
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
    queries = replace(queries, sequence_b=np.array(sequences, np.int32))
    answers = PlacedAnswers(ANSWERS, answered=5)
    found = list(read_blocks(queries, read_tables(queries, truth), answers, block_rows=block_rows))
    assert [block.pairs.stop for block in found] == ends
    assert [block.pairs.start for block in found] == [0, *ends[:-1]]
    np.testing.assert_array_equal(np.concatenate([each.answer_px for each in found]), ANSWERS)


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
    queries, truth = written(tmp_path, **columns)
    with pytest.raises(SpecError, match=said):
        list(
            read_blocks(
                queries,
                read_tables(queries, truth),
                PlacedAnswers(ANSWERS, answered=5),
                block_rows=3,
            )
        )


def test_a_truth_of_more_rows_is_refused(tmp_path: Path) -> None:
    queries, truth = written(tmp_path)
    longer = pq.read_table(truth)
    pq.write_table(pa.concat_tables([longer, longer.slice(4)]), truth)
    with pytest.raises(SpecError, match="6 rows; required: 5 rows"):
        list(read_blocks(queries, read_tables(queries, truth), PlacedAnswers(ANSWERS, answered=5)))


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
