"""A split made by hand, for metrics whose figures can be worked out on paper."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from pliant.evaluator.metrics.base import (
    Groups,
    Metric,
    NoSettings,
    PairTable,
    ScoringContext,
    Summary,
)
from pliant.evaluator.metrics.blocks import Block, Partners
from pliant.evaluator.metrics.localisation import Counts
from pliant.evaluator.submission.answers import PlacedAnswers
from pliant.evaluator.submission.queries import Queries
from pliant.spec.conventions import VISIBLE

HIDDEN = VISIBLE + 1
_CODES = ("tier", "sequence_a", "sequence_b", "frame_a", "frame_b")


def split(sizes: Sequence[int], **more: Any) -> Queries:
    """Return pairs with so many queries each.

    If not said otherwise they are of the tier `t` and the sequence `s`, from frame 0 to frame 1 of
    40x30 images: a diagonal of 50 px, an area of 1,200 px2.
    """
    pairs = len(sizes)
    usual: dict[str, Any] = {
        "split": "test", "path": Path("queries.parquet"), "tiers": ["t"], "sequences": ["s"],
        "size": (40, 30), "starts": np.cumsum([0, *sizes]),
        **dict.fromkeys(_CODES, np.zeros(pairs, np.int32)), "frame_b": np.ones(pairs, np.int32),
    }  # fmt: skip
    codes = {name: np.array(more.pop(name), np.int32) for name in _CODES if name in more}
    return Queries(**usual | codes | more)


def episodes(temporal: bool = True, **tiers: Any) -> Any:
    """Return a dataset all of whose sequences are episodes, or none, of the given tiers."""
    sequence = SimpleNamespace(temporal=temporal, shape=None)
    return SimpleNamespace(sequence=lambda _: sequence, tiers=tiers)


class Split:
    """Queries, their truth and their answers; blocks of them, and what a metric says.

    Args:
        queries: The queries.
        answer_px: (N, 2), the answers; NaN where missing.
        true_px: (N, 2), the truth, (10, 10) if not given.
        hidden: Rows of hidden points.
        cut: The pair that begins the second block.
        answers: Further columns of the answers.
        dataset, surfaces: Stand-ins of the dataset and its surface images.
        partners: Of each row (u, v, visible) of its symmetric partners.
        rows: Further arrays of the blocks, a value per row.
    """

    def __init__(
        self, queries: Queries, answer_px: Any, true_px: Any = None, hidden: Sequence[int] = (),
        *, cut: int = 1, answers: dict[str, Any] | None = None, dataset: Any = None,
        surfaces: Any = None, partners: Sequence[Sequence[tuple[float, float, bool]]] | None = None,
        **rows: Any,
    ) -> None:  # fmt: skip
        count = queries.rows
        uv_px = np.asarray(answer_px, float)
        state = np.full(count, VISIBLE, np.uint8)
        state[list(hidden)] = HIDDEN
        missing = np.isnan(uv_px[:, 0])
        true = np.full((count, 2), 10.0) if true_px is None else np.asarray(true_px, float)
        self.rows = {"answer_px": uv_px, "true_px": true, "state": state, **rows}
        if missing.any():
            self.rows["missing"] = missing
        self.queries, self.cut, self.partners = queries, cut, partners
        self.context = ScoringContext(
            dataset or episodes(), queries, PlacedAnswers(uv_px, **answers or {}),
            PairTable(queries.pairs, []), surfaces,
        )  # fmt: skip

    def block(self, first_pair: int, end_pair: int, **more: Any) -> Block:
        """Return a block of some pairs."""
        first, end = (int(self.queries.starts[pair]) for pair in (first_pair, end_pair))
        rows = {name: values[first:end] for name, values in self.rows.items()}
        starts = self.queries.starts[first_pair : end_pair + 1] - first
        if self.partners is not None:
            more["partners"] = partners_of(self.partners[first:end])
        known = {"missing": None, "missing_px": self.queries.diagonal_px, **rows, **more}
        return Block(first_row=first, first_pair=first_pair, starts=starts, **known)

    def blocks(self) -> list[Block]:
        """Return two blocks, or one if there is nothing to cut."""
        ends = sorted({0, min(self.cut, self.queries.pairs), self.queries.pairs})
        return [self.block(first, end) for first, end in pairwise(ends)]

    def found(self, metric: Metric[Any], *before: Metric[Any]) -> Summary:
        """Return what a metric says after the blocks have passed, and `before` before it."""
        summary, groups = Summary(), Groups.of(self.queries, self.queries.starts)
        metrics = [Counts(NoSettings(), self.context), *before, metric]
        for block in self.blocks():
            for each in metrics:
                each.update(block)
        for each in metrics:
            each.finish(groups, summary)
        return summary

    def column(self, name: str) -> list[float]:
        """Return a column of the pair table."""
        return self.context.table.columns[name].tolist()


def off_by(*error_px: float) -> np.ndarray:
    """Return answers to the right of (10, 10), float64 (N, 2)."""
    return np.array([[10 + each, 10] for each in error_px], float)


def partners_of(rows: Sequence[Sequence[tuple[float, float, bool]]]) -> Partners:
    """Return the symmetric partners of a block from (u, v, visible) of each row."""
    flat = np.array([each for row in rows for each in row], float).reshape(-1, 3)
    return Partners(np.cumsum([0, *map(len, rows)]), flat[:, :2], flat[:, 2] > 0)
