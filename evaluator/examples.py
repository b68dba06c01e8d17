"""Picks the pairs that a report draws: of each tier from the best to the worst, evenly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.evaluator.metrics.blocks import SplitTables, positions_px
from pliant.evaluator.metrics.causes import CAUSES, NO_CAUSE
from pliant.evaluator.submission.answers import PlacedAnswers
from pliant.evaluator.submission.queries import Queries
from pliant.spec.arrays import FloatArray
from pliant.spec.conventions import VISIBILITY_STATES, VISIBLE
from pliant.spec.io.parquet_columns import codes

Codes = npt.NDArray[np.uint8]

_MOST_PAIRS: Final = 48
_MOST_QUERIES: Final = 24


@dataclass(frozen=True)
class Example:
    """One pair with some of its queries, spread over their order of error.

    Attributes:
        rank: Its place among its tier's pairs by RMSE, 1 for the smallest.
        of: Number of pairs of its tier.
        tier: Its tier.
        pair: Its id.
        sequence_a, frame_a, sequence_b, frame_b: Its frames.
        rmse_px: RMSE over all of its counted queries.
        cause: Name of the cause of most of its squared error, or empty.
        uv_a_px, true_px, answer_px: float64 (Q, 2), Q at most 24.
        causes: uint8 (Q,), the causes as indices of `CAUSES`; `NO_CAUSE` where not known.
    """

    rank: int
    of: int
    tier: str
    pair: int
    sequence_a: str
    frame_a: int
    sequence_b: str
    frame_b: int
    rmse_px: float
    cause: str
    uv_a_px: FloatArray
    true_px: FloatArray
    answer_px: FloatArray
    causes: Codes

    @property
    def error_px(self) -> FloatArray:
        """float64 (Q,), the distance of each answer from the truth."""
        error: FloatArray = np.linalg.norm(self.answer_px - self.true_px, axis=1)
        return error

    @property
    def points(self) -> list[list[Any]]:
        """For each query: source u, v; truth u, v; answer u, v; error, all px; cause or -1."""
        code = np.where(self.causes == NO_CAUSE, -1, self.causes.astype(int))
        places = np.concatenate([self.uv_a_px, self.true_px, self.answer_px], axis=1)
        values = np.concatenate([places, self.error_px[:, None]], axis=1).round(1)
        return [[*row, index] for row, index in zip(values.tolist(), code.tolist(), strict=True)]


def choose_examples(
    answers: PlacedAnswers,
    queries: Queries,
    columns: Mapping[str, FloatArray],
    tables: SplitTables,
    causes: Codes | None,
) -> tuple[Example, ...]:
    """Return pairs of each tier, from the best to the worst by RMSE.

    Args:
        answers: The answers.
        queries: The queries.
        columns: The pair table.
        tables: The truth and the query pixels.
        causes: uint8 (R,), the cause of each answer as its index in `CAUSES`, or None.
    """
    if "sum_squared_px2" not in columns or tables.asked is None:
        return ()
    counted = columns["counted"]
    rmse = np.sqrt(columns["sum_squared_px2"] / np.maximum(counted, 1))
    most = max(2, _MOST_PAIRS // len(queries.tiers))
    examples = []
    for code in range(len(queries.tiers)):
        pairs = np.flatnonzero((queries.tier == code) & (counted > 0))
        order = pairs[np.argsort(rmse[pairs], kind="stable")]
        chosen = np.unique(np.linspace(0, max(len(order) - 1, 0), most).round().astype(int))
        for place in chosen[: len(order)].tolist():
            pair = int(order[place])
            found = _rows(pair, answers, queries, tables.asked, tables.truth, causes)
            examples.append(
                Example(
                    rank=place + 1,
                    of=len(order),
                    tier=queries.tiers[code],
                    pair=pair,
                    sequence_a=queries.sequences[queries.sequence_a[pair]],
                    frame_a=int(queries.frame_a[pair]),
                    sequence_b=queries.sequences[queries.sequence_b[pair]],
                    frame_b=int(queries.frame_b[pair]),
                    rmse_px=float(rmse[pair]),
                    cause=_main_cause(columns, pair),
                    **found,
                )
            )
    return tuple(examples)


def _main_cause(columns: Mapping[str, FloatArray], pair: int) -> str:
    parts = {
        cause.name: columns[f"cause_{cause.name}_px2"][pair]
        for cause in CAUSES
        if cause.name != "hidden" and f"cause_{cause.name}_px2" in columns
    }
    largest = max(parts, key=lambda name: parts[name], default="")
    return largest if largest and parts[largest] > 0 else ""


def _rows(
    pair: int,
    answers: PlacedAnswers,
    queries: Queries,
    asked: pa.Table,
    true: pa.Table,
    causes: Codes | None,
) -> dict[str, Any]:
    """Return some visible queries of a pair with their truth, answer and cause."""
    begin, end = int(queries.starts[pair]), int(queries.starts[pair + 1])
    table = true.slice(begin, end - begin)
    true_px = positions_px(table, "u_b", "v_b")
    uv_a = positions_px(asked.slice(begin, end - begin), "u_a", "v_a")
    answer = answers.uv_px[begin:end].astype(np.float64)
    visible = codes(table["visibility_b"], VISIBILITY_STATES) == VISIBLE
    usable = np.flatnonzero(visible & np.isfinite(answer[:, 0]))
    error = np.linalg.norm(answer[usable] - true_px[usable], axis=1)
    order = usable[np.argsort(error, kind="stable")]
    pick = np.unique(np.linspace(0, len(order) - 1, _MOST_QUERIES).round().astype(int))
    rows = order[pick] if len(order) else order
    none = np.full(end - begin, NO_CAUSE, np.uint8)
    found = none if causes is None else np.asarray(causes[begin:end])
    return {
        "uv_a_px": uv_a[rows],
        "true_px": true_px[rows],
        "answer_px": answer[rows],
        "causes": found[rows],
    }
