"""Mutations of queries and truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.conformance.accepted import held_out
from tests.conformance.edits import (
    ROPE_TEST,
    Edit,
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

EDITS: dict[str, Edit] = {
    "query-moved": _asked(_shift("u_a", 0.01)),
    "query-nan": _asked(_set(2, u_a=float("nan"))),
    "query-on-background": _asked(_set(2, u_a=1.5, v_a=1.5)),
    "query-of-unknown-sequence": _asked(_pair(sequence_b="rope-test-000009")),
    "query-of-unknown-frame": _asked(_pair(frame_b=2)),
    "query-of-other-split": _asked(_pair(sequence_a="rope-train-000000")),
    "query-of-other-tier": _asked(_pair(sequence_b=_BARE, frame_b=0)),
    "query-within-one-frame": _asked(_pair(frame_b=0)),
    "query-pair-mixed": _asked(_set(2, frame_a=1)),
    "query-ids-gap": _asked(_set(4, query_id=5)),
    "query-twice": _asked(_set(1, query_id=0)),
    "pair-ids-gap": _gap_both,
    "truth-of-other-queries": change_footer(
        _TRUTH, lambda footer: footer.update(queries_sha256="0" * 64)
    ),
    "truth-without-queries": remove(_QUERIES),
    "truth-rounded": change_rows(_TRUTH, _rounded),
    "truth-moved": change_rows(_TRUTH, _shift("v_b", 0.01)),
    "truth-other-state": change_rows(_TRUTH, _other_state),
    "truth-other-point": change_rows(_TRUTH, _set(0, point=70)),
    "truth-other-box": change_rows(_TRUTH, _set(0, box_px=3.0)),
    "truth-other-tier": change_rows(_TRUTH, _set(0, tier="rope-bare")),
    "truth-alternatives-swapped": change_rows(_TRUTH, _swap_alternatives),
    "truth-alternatives-missing": change_rows(_TRUTH, _no_alternatives),
    "truth-row-missing": change_rows(_TRUTH, _drop_last),
    "truth-row-extra": change_rows(_TRUTH, _repeat_last),
    "truth-rows-swapped": change_rows(_TRUTH, _swap),
    "held-out-with-truth": _held_out_but("truth/test.parquet"),
    "held-out-with-depth": _held_out_but(f"{ROPE_TEST}/depth/000000.exr"),
    "held-out-with-tracks": _held_out_but(f"{ROPE_TEST}/correspondences.parquet"),
    "held-out-with-parameters": both(
        held_out,
        change_json(
            f"{ROPE_TEST}/sequence.json", lambda document: document.update(parameters={"knots": 1})
        ),
    ),
    "held-out-query-outside": both(held_out, change_rows(_QUERIES, _set(2, u_a=64.0))),
}
"""Every mutation of this kind."""
