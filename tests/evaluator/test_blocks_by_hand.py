"""The pair table, groups of pairs, listed figures, and blocks that are read from a small truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.evaluator.metrics import blocks
from pliant.evaluator.metrics.base import Groups, Metric, PairTable, Summary
from pliant.evaluator.metrics.blocks import check_truth, read_blocks
from pliant.evaluator.metrics.causes import Causes, cause_rows
from pliant.evaluator.metrics.figures import _figures
from pliant.evaluator.statistics.ratios import Figure, Ratio
from pliant.evaluator.submission.answers import SplitAnswers
from pliant.evaluator.submission.queries import Queries
from pliant.spec.errors import SpecError
from pliant.spec.io.parquet import write_table
from pliant.spec.tables import TRUTH
from tests.evaluator.hand_made import HIDDEN, Split, off_by, split

NAN = math.nan


def test_the_pair_table() -> None:
    table = PairTable(3, ["a"])
    table.put("a", slice(0, 1), np.array([5]))
    table.put("a", slice(2, 3), np.array([7]))
    table.put("b", slice(1, 3), np.array([True, True]))
    found = {name: values.tolist() for name, values in table.columns.items()}
    assert found == {"a": [5, 0, 7], "one": [1, 1, 1], "b": [0, 1, 1]}


def test_groups_of_pairs() -> None:
    queries = split([2, 3, 1, 2], tiers=["x", "y"], tier=[0, 1, 1, 0])
    groups = Groups.of(queries, queries.starts)
    assert list(groups) == [(0, "overall"), (1, "x"), (2, "y")]
    assert [mask.tolist() for mask in groups.masks] == [
        [True] * 4, [True, False, False, True], [False, True, True, False],
    ]  # fmt: skip
    values = np.arange(8)
    parts = [[part.tolist() for part in groups.rows(index, values)] for index in range(3)]
    assert parts == [[list(range(8))], [[0, 1], [6, 7]], [[2, 3, 4, 5]]]


def test_figures_that_are_not_defined_are_none() -> None:
    summary = Summary()
    for name, value in {"none": None, "nan": NAN, "inf": math.inf, "zero": 0, "two": 2}.items():
        summary.set("overall", name, value)
    summary.set("x", "two", 2.0)
    undefined = dict.fromkeys(("none", "nan", "inf"))
    assert summary.values == {"overall": {**undefined, "zero": 0, "two": 2}, "x": {"two": 2}}
    summary.add_curve("x", "a", {"edges": [1]})
    summary.add_curve("x", "b", {"edges": [2]})
    assert summary.curves == {"x": {"a": {"edges": [1]}, "b": {"edges": [2]}}}


def test_a_metric_without_figures_and_an_end() -> None:
    made = Split(split([1]), off_by(0))
    metric: Metric[Any] = Metric(None, made.context)
    assert metric.table is made.context.table
    with pytest.raises(NotImplementedError):
        metric.update(made.block(0, 1))
    metric.finish(Groups.of(made.queries, made.queries.starts), Summary())
    assert Metric.figures({}) == []
    np.testing.assert_array_equal(made.context.per_row(), [NAN])


def test_figures_are_listed_for_each_value() -> None:
    rows: list[dict[str, Any]] = [
        {"name": "plain", "better": "lower", "about": "of {family}"},
        {
            "each": "levels",
            "figures": [
                {
                    "name": "p{percent:g}", "better": "higher", "unit": "px", "about": "{each:g}",
                    "label": "L{each:g}", "over": ["a{percent:g}", "b"], "root": True,
                    "mean_over_pairs": "mean of {each:g}",
                }
            ],
        },
        {"each": "one", "figures": [{"name": "q{each}", "better": "lower", "over": ["c", "d"]}]},
        {"each": "none", "figures": [{"name": "r", "better": "lower"}]},
        {"name": "last", "better": "neither"},
    ]  # fmt: skip
    words = {"family": "f", "levels": (0.25, 0.5), "one": 3, "none": None}
    found = list(_figures(rows, words))
    first = Ratio("p25", "higher", "px", "0.25", "L0.25", "a25", "b", root=True)
    assert found[:2] == [Figure("plain", "lower", "", "of f"), first]
    assert found[2].name == "p25_mean_over_pairs"
    assert found[2].about == "mean of 0.25"
    assert found[5:] == [
        Ratio("q3", "lower", "", "", "", "c", "d"), Figure("last", "neither", "", ""),
    ]  # fmt: skip
    assert [each.name for each in found[3:5]] == ["p50", "p50_mean_over_pairs"]


def test_what_a_block_says_of_its_rows() -> None:
    made = Split(split([2, 1, 2]), np.concatenate([off_by(3, 1, 2, 4), [[NAN, NAN]]]), hidden=[3])
    block = made.block(1, 3)
    assert (block.rows, block.pairs) == (slice(2, 5), slice(1, 3))
    assert block.pair.tolist() == [0, 1, 1]
    assert block.counted.tolist() == [True, False, True]
    assert block.squared_px2.tolist() == [4, 16, 2500]
    assert block.error_px.tolist() == [2, 4, 50]
    assert block.reach_px.tolist() == [2, 4, math.inf]
    assert block.sum_by_pair(block.counted).tolist() == [1, 1]
    whole = made.block(0, 1, missing=None)
    assert whole.reach_px.tolist() == [3, 1]


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


def test_blocks_are_read_with_what_is_asked_for(tmp_path: Path) -> None:
    queries, truth = written(tmp_path)
    answers = SplitAnswers(ANSWERS, answered=5)
    first, second = read_blocks(queries, truth, answers, block_rows=3)
    assert (first.first_row, first.first_pair, first.starts.tolist()) == (0, 0, [0, 2, 3])
    assert (second.first_row, second.first_pair, second.starts.tolist()) == (3, 2, [0, 2])
    np.testing.assert_array_equal(second.answer_px, ANSWERS[3:])
    np.testing.assert_array_equal(second.true_px, [[10.0, 10], [NAN, NAN]])
    assert second.state.tolist() == [0, HIDDEN]
    assert second.missing_px == 50
    for name in ("missing", "uv_a_px", "point", "box_px", "partners"):
        assert getattr(second, name) is None
    columns = ("point", "box_px", "alternatives")
    _, second = read_blocks(
        queries, truth, answers, truth_columns=columns, query_pixels=True, block_rows=3
    )
    assert second.point is not None
    assert second.box_px is not None
    assert second.uv_a_px is not None
    assert second.partners is not None
    assert second.point.tolist() == [10, 11]
    assert second.box_px.tolist() == [23, 24]
    np.testing.assert_array_equal(second.uv_a_px, [[4, 9], [5, 10]])
    assert second.partners.begin.tolist() == [0, 2, 2]
    assert len(list(read_blocks(queries, truth, answers))) == 1


def test_missing_answers_are_those_that_are_nan(tmp_path: Path) -> None:
    queries, truth = written(tmp_path)
    uv_px = ANSWERS.copy()
    uv_px[1] = NAN
    (block,) = read_blocks(queries, truth, SplitAnswers(uv_px, answered=4))
    assert block.missing is not None
    assert block.missing.tolist() == [False, True, False, False, False]


def test_errors_of_visible_points_are_capped(tmp_path: Path) -> None:
    queries, truth = written(tmp_path)
    (block,) = read_blocks(queries, truth, SplitAnswers(ANSWERS, answered=5), cap_errors=True)
    np.testing.assert_array_equal(block.answer_px, [*off_by(3, 0, 50, 4), [700, 10]])
    (block,) = read_blocks(queries, truth, SplitAnswers(ANSWERS, answered=5))
    np.testing.assert_array_equal(block.answer_px, ANSWERS)
    # A length that is the bound stays as it is, to the last bit.
    answer = np.array([[0.1, 0.7]])
    true = np.array([[100.3, 4.9]])
    assert (true + (answer - true) != answer).any()
    length = np.hypot(*(answer - true).T)[0]
    same = blocks._capped(answer, true, np.array([True]), length)
    assert (same == answer).all()


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
        list(read_blocks(queries, truth, SplitAnswers(ANSWERS, answered=5), block_rows=3))


def test_a_truth_of_more_rows_is_refused(tmp_path: Path) -> None:
    queries, truth = written(tmp_path)
    longer = pq.read_table(truth)
    pq.write_table(pa.concat_tables([longer, longer.slice(4)]), truth)
    with pytest.raises(SpecError, match="6 rows; required: 5 rows"):
        list(read_blocks(queries, truth, SplitAnswers(ANSWERS, answered=5)))


@pytest.mark.parametrize("wrong", ["dataset_id", "dataset_version", "split", "sha"])
def test_a_truth_of_something_else_is_refused(wrong: str, tmp_path: Path) -> None:
    path = tmp_path / "truth.parquet"
    right = {"dataset_id": "d", "dataset_version": "1.0.0", "split": "test", "sha": "0" * 64}
    footer = {"dataset": {"id": "d", "version": "1.0.0"}, "split": "test"}
    write_table(path, TRUTH.empty_table(), "truth", {**footer, "queries_sha256": "0" * 64})
    check_truth(path, **right)
    with pytest.raises(SpecError, match="the truth does not belong to these queries"):
        check_truth(path, **right | {wrong: "f" * 64})
    with pytest.raises(SpecError, match="is not here"):
        check_truth(tmp_path, **right)


def test_shares_of_causes() -> None:
    names = (
        "imprecision", "flip", "off_object", "layer", "across", "along", "missing", "hidden",
    )  # fmt: skip
    sums = {f"cause_{name}_{key}": 0.0 for name in names for key in ("answers", "px2")}
    sums |= {"cause_flip_answers": 3, "cause_flip_px2": 48, "cause_along_answers": 1}
    sums |= {"cause_along_px2": 16, "cause_hidden_answers": 4, "cause_hidden_px2": 400}
    rows = cause_rows(sums)
    assert rows["flip"] == {
        "answers": 3, "answers_share": 0.75, "squared_error_share": 0.75, "rmse_px": 4,
    }  # fmt: skip
    assert rows["along"]["squared_error_share"] == 0.25
    assert rows["layer"] == {
        "answers": 0, "answers_share": 0, "squared_error_share": 0, "rmse_px": None,
    }  # fmt: skip
    assert rows["hidden"] == {
        "answers": 4, "answers_share": None, "squared_error_share": None, "rmse_px": 10,
    }  # fmt: skip
    perfect = cause_rows(sums | {"cause_flip_px2": 0, "cause_along_px2": 0})
    assert perfect["flip"] == {
        "answers": 3, "answers_share": 0.75, "squared_error_share": None, "rmse_px": 0,
    }  # fmt: skip
    none = cause_rows(sums | {"cause_flip_answers": 0, "cause_along_answers": 0})
    assert none["flip"]["answers_share"] is None


@pytest.mark.parametrize(
    ("counted", "known", "left_out"),
    [
        ([2, 1, 0], [2, 1, 0], ""),
        ([2, 1, 3], [2, 0, 0], "2 of 3 pairs"),
        ([2, 0, 0], [0, 0, 0], None),
    ],
)
def test_pairs_without_causes_are_said(
    counted: list[int], known: list[int], left_out: str | None
) -> None:
    queries = split([1, 1, 1], tiers=["x", "y"], tier=[0, 0, 1])
    made = Split(queries, off_by(0, 0, 0))
    metric = Causes.__new__(Causes)
    metric.table = made.context.table
    everything = slice(0, 3)
    metric.table.put("counted", everything, np.array(counted))
    metric.table.put("causes_known", everything, np.array(known))
    from pliant.evaluator.metrics.causes import CAUSES

    for cause in CAUSES:
        for key in ("answers", "px2"):
            metric.table.put(f"cause_{cause.name}_{key}", everything, np.array([1, 2, 4]))
    summary = Summary()
    metric.finish(Groups.of(queries, queries.starts), summary)
    if left_out is None:
        assert not summary.causes
        assert not summary.notes
        return
    assert {name: rows["flip"]["answers"] for name, rows in summary.causes.items()} == {
        "overall": 7, "x": 3, "y": 4,
    }  # fmt: skip
    assert summary.notes.get("causes", "").startswith(left_out)
    assert bool(left_out) == ("causes" in summary.notes)
