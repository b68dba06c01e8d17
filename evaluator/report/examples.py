"""Picks the pairs a report draws: of each tier the worst and the median one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pliant.evaluator.arrays import BoolArray, FloatArray
from pliant.evaluator.submission.answers import Answers
from pliant.evaluator.submission.matches import Matches
from pliant.evaluator.submission.queries import Queries
from pliant.evaluator.submission.stream import numbers
from pliant.spec.io.parquet import read_rows

_MOST_QUERIES: Final = 16


@dataclass(frozen=True)
class Example:
    """One pair with some of its queries, spread over their order of error.

    Attributes:
        rank: `worst` or `median` of its tier by the pair's RMSE.
        tier: Its tier.
        pair: Its id.
        sequence_a, frame_a, sequence_b, frame_b: Its frames.
        rmse_px: RMSE over all of its counted queries.
        uv_a_px, true_px, answer_px: float64 (Q, 2), Q at most 16.
    """

    rank: str
    tier: str
    pair: int
    sequence_a: str
    frame_a: int
    sequence_b: str
    frame_b: int
    rmse_px: float
    uv_a_px: FloatArray
    true_px: FloatArray
    answer_px: FloatArray


def choose_examples(
    answers: Answers | Matches,
    queries: Queries,
    columns: Mapping[str, FloatArray],
    truth: Path,
) -> tuple[Example, ...]:
    """Return the worst and the median pair of each tier.

    Args:
        answers: The answers; keypoint matches have no examples.
        queries: The queries.
        columns: The pair table.
        truth: The truth file.
    """
    if isinstance(answers, Matches) or "sum_squared_px2" not in columns:
        return ()
    counted = columns["counted"]
    rmse = np.sqrt(columns["sum_squared_px2"] / np.maximum(counted, 1))
    examples = []
    for code in range(len(queries.tiers)):
        pairs = np.flatnonzero((queries.tier == code) & (counted > 0))
        if not len(pairs):
            continue
        order = pairs[np.argsort(rmse[pairs], kind="stable")]
        chosen = {"median": order[(len(order) - 1) // 2], "worst": order[-1]}
        for rank, pair in chosen.items():
            example = _example(rank, int(pair), float(rmse[pair]), answers, queries, truth)
            examples.append(example)
    return tuple(examples)


def _example(
    rank: str, pair: int, rmse_px: float, answers: Answers, queries: Queries, truth: Path
) -> Example:
    begin, end = int(queries.starts[pair]), int(queries.starts[pair + 1])
    table = read_rows(truth, "truth", begin, end, ["u_b", "v_b", "visibility_b"])
    asked = read_rows(queries.path, "queries", begin, end, ["u_a", "v_a"])
    true_px = np.stack([numbers(table[n], np.float64) for n in ("u_b", "v_b")], axis=1)
    uv_a = np.stack([numbers(asked[n], np.float64) for n in ("u_a", "v_a")], axis=1)
    answer = answers.uv_px[begin:end].astype(np.float64)
    visible: BoolArray = np.array([s == "visible" for s in table["visibility_b"].to_pylist()])
    usable = np.flatnonzero(visible & np.isfinite(answer[:, 0]))
    error = np.linalg.norm(answer[usable] - true_px[usable], axis=1)
    order = usable[np.argsort(error, kind="stable")]
    pick = np.unique(np.linspace(0, len(order) - 1, _MOST_QUERIES).round().astype(int))
    rows = order[pick] if len(order) else order
    return Example(
        rank=rank,
        tier=queries.tiers[queries.tier[pair]],
        pair=pair,
        sequence_a=queries.sequences[queries.sequence_a[pair]],
        frame_a=int(queries.frame_a[pair]),
        sequence_b=queries.sequences[queries.sequence_b[pair]],
        frame_b=int(queries.frame_b[pair]),
        rmse_px=rmse_px,
        uv_a_px=uv_a[rows],
        true_px=true_px[rows],
        answer_px=answer[rows],
    )
