"""Mutations of queries and truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.conformance.accepted import held_out
from tests.conformance.edits import (
    ROPE_TEST,
    Case,
    both,
    change_footer,
    change_json,
    change_rows,
    listed,
    rebound,
    remove,
)

_QUERIES = "queries/test.parquet"
_TRUTH = "truth/test.parquet"

Rows = list[dict[str, Any]]


def _asked(change: Any) -> Any:
    """Edit the queries, and the truth's footer with them."""
    return rebound(_QUERIES, change_rows(_QUERIES, change))


def _pair(**values: Any) -> Any:
    """Return a change of every row of the first pair."""

    def change(rows: Rows) -> None:
        for row in rows:
            if row["pair_id"] == 0:
                row.update(values)

    return change


def _set(row: int, **values: Any) -> Any:
    def change(rows: Rows) -> None:
        rows[row].update(values)

    return change


def _shift(name: str, amount: float) -> Any:
    def change(rows: Rows) -> None:
        rows[2][name] += amount

    return change


def _rounded(rows: Rows) -> None:
    for row in rows:
        row["u_b"], row["v_b"] = float(round(row["u_b"])), float(round(row["v_b"]))


def _other_state(rows: Rows) -> None:
    state = rows[0]["visibility_b"]
    rows[0]["visibility_b"] = "occluded" if state == "visible" else "visible"


def _drop_last(rows: Rows) -> None:
    rows.pop()


def _repeat_last(rows: Rows) -> None:
    rows.append(dict(rows[-1]))


def _swap(rows: Rows) -> None:
    rows[0], rows[1] = rows[1], rows[0]


def _gap(rows: Rows) -> None:
    for row in rows:
        if row["pair_id"] > 0:
            row["pair_id"] += 1


def _swap_alternatives(rows: Rows) -> None:
    rows[-1]["alternatives"].reverse()


def _no_alternatives(rows: Rows) -> None:
    rows[-1]["alternatives"] = []


def _gap_both(root: Path) -> None:
    change_rows(_QUERIES, _gap)(root)
    change_rows(_TRUTH, _gap)(root)
    rebound(_QUERIES)(root)


def _held_out_but(path: str) -> Any:
    """Hold the test split out, and leave one telling file where it was."""

    def edit(root: Path) -> None:
        data = (root / path).read_bytes()
        held_out(root)
        (root / path).parent.mkdir(exist_ok=True)
        (root / path).write_bytes(data)
        listed()(root)

    return edit


_BARE = "rope-bare-test-000000"

CASES = [
    Case(
        "query-moved",
        "full",
        "a query is 0.01 pixel beside its point",
        ("QUERY_NOT_VISIBLE",),
        _asked(_shift("u_a", 0.01)),
    ),
    Case(
        "query-nan",
        "full",
        "a query's u_a is NaN",
        ("VALUE_NOT_FINITE",),
        _asked(_set(2, u_a=float("nan"))),
    ),
    Case(
        "query-on-background",
        "full",
        "a query lies where nothing is seen",
        ("QUERY_NOT_VISIBLE",),
        _asked(_set(2, u_a=1.5, v_a=1.5)),
    ),
    Case(
        "query-of-unknown-sequence",
        "full",
        "a pair names a sequence that is not there",
        ("QUERY_INVALID",),
        _asked(_pair(sequence_b="rope-test-000009")),
    ),
    Case(
        "query-of-unknown-frame",
        "full",
        "a pair names frame 2 of a sequence of two frames",
        ("QUERY_INVALID",),
        _asked(_pair(frame_b=2)),
    ),
    Case(
        "query-of-other-split",
        "full",
        "a pair of the test split names a training sequence",
        ("QUERY_INVALID",),
        _asked(_pair(sequence_a="rope-train-000000")),
    ),
    Case(
        "query-of-other-tier",
        "full",
        "a pair's target is of another tier",
        ("QUERY_INVALID",),
        _asked(_pair(sequence_b=_BARE, frame_b=0)),
    ),
    Case(
        "query-within-one-frame",
        "full",
        "a pair's source and target are one frame",
        ("QUERY_INVALID",),
        _asked(_pair(frame_b=0)),
    ),
    Case(
        "query-pair-mixed",
        "full",
        "the rows of a pair name different frames",
        ("QUERY_INVALID",),
        _asked(_set(2, frame_a=1)),
    ),
    Case(
        "query-ids-gap",
        "full",
        "the query ids of a pair skip a number",
        ("ROW_ORDER",),
        _asked(_set(4, query_id=5)),
    ),
    Case(
        "query-twice",
        "full",
        "two queries of a pair have one id",
        ("ROW_ORDER",),
        _asked(_set(1, query_id=0)),
    ),
    Case(
        "pair-ids-gap",
        "full",
        "the pair ids skip a number, in queries and truth",
        ("ROW_ORDER",),
        _gap_both,
    ),
    Case(
        "truth-of-other-queries",
        "full",
        "the truth names the sha256 of another queries file",
        ("QUERIES_MISMATCH",),
        change_footer(_TRUTH, lambda footer: footer.update(queries_sha256="0" * 64)),
    ),
    Case(
        "truth-without-queries",
        "full",
        "the queries are removed, the truth stays",
        ("FILE_MISSING",),
        remove(_QUERIES),
    ),
    Case(
        "truth-rounded",
        "full",
        "the truth is rounded to whole pixels",
        ("TRUTH_DISAGREES",),
        change_rows(_TRUTH, _rounded),
    ),
    Case(
        "truth-moved",
        "full",
        "one answer is moved by 0.01 pixel",
        ("TRUTH_DISAGREES",),
        change_rows(_TRUTH, _shift("v_b", 0.01)),
    ),
    Case(
        "truth-other-state",
        "full",
        "visibility_b of one answer is changed",
        ("TRUTH_DISAGREES",),
        change_rows(_TRUTH, _other_state),
    ),
    Case(
        "truth-other-point",
        "full",
        "one answer names another point",
        ("TRUTH_DISAGREES",),
        change_rows(_TRUTH, _set(0, point=70)),
    ),
    Case(
        "truth-other-box",
        "full",
        "box_px of one answer is changed",
        ("TRUTH_DISAGREES",),
        change_rows(_TRUTH, _set(0, box_px=3.0)),
    ),
    Case(
        "truth-other-tier",
        "full",
        "the tier of one answer is changed",
        ("TRUTH_DISAGREES",),
        change_rows(_TRUTH, _set(0, tier="rope-bare")),
    ),
    Case(
        "truth-alternatives-swapped",
        "full",
        "the alternatives of one answer are in another order",
        ("TRUTH_DISAGREES",),
        change_rows(_TRUTH, _swap_alternatives),
    ),
    Case(
        "truth-alternatives-missing",
        "full",
        "one answer lacks its alternatives",
        ("TRUTH_DISAGREES",),
        change_rows(_TRUTH, _no_alternatives),
    ),
    Case(
        "truth-row-missing",
        "full",
        "the last answer is dropped",
        ("ROW_MISSING",),
        change_rows(_TRUTH, _drop_last),
    ),
    Case(
        "truth-row-extra",
        "full",
        "the last answer is repeated",
        ("ROW_UNKNOWN",),
        change_rows(_TRUTH, _repeat_last),
    ),
    Case(
        "truth-rows-swapped",
        "full",
        "two answers change places",
        ("ROW_ORDER",),
        change_rows(_TRUTH, _swap),
    ),
    Case(
        "held-out-with-truth",
        "full",
        "a held-out split comes with its truth",
        ("HELD_OUT_LEAKS",),
        _held_out_but("truth/test.parquet"),
    ),
    Case(
        "held-out-with-depth",
        "full",
        "a held-out sequence comes with a depth image",
        ("HELD_OUT_LEAKS",),
        _held_out_but(f"{ROPE_TEST}/depth/000000.exr"),
    ),
    Case(
        "held-out-with-tracks",
        "full",
        "a held-out sequence comes with its correspondences",
        ("HELD_OUT_LEAKS",),
        _held_out_but(f"{ROPE_TEST}/correspondences.parquet"),
    ),
    Case(
        "held-out-with-parameters",
        "full",
        "a held-out sequence.json tells the sampled parameters",
        ("HELD_OUT_LEAKS",),
        both(
            held_out,
            change_json(
                f"{ROPE_TEST}/sequence.json",
                lambda document: document.update(parameters={"knots": 1}),
            ),
        ),
    ),
    Case(
        "held-out-query-outside",
        "full",
        "a query of a held-out split lies outside the image",
        ("VALUE_OUT_OF_RANGE",),
        both(held_out, change_rows(_QUERIES, _set(2, u_a=64.0))),
    ),
]
"""Every mutation of this kind."""
