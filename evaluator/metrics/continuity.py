"""Continuity of answers: jumps and local stretch between neighbouring queries.

The paper mentions "large discontinuous jumps" between the answers of neighbouring pixels. Here
a neighbour is the nearest other query of the source frame, and a pair of neighbours is used
only if their true positions are close in the target too.
"""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np

from pliant.evaluator.metrics.base import Groups, Level, Metric, Positive, ScoringContext, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.errors import endpoint_error_px, exact_quantiles
from pliant.spec.arrays import BoolArray, FloatArray, IntArray, RealArray
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds

_CHUNK_CELLS: Final = 1 << 17
"""Distances computed at once; they stay in the processor's cache."""


class ContinuitySettings(Settings):
    """Settings of `continuity`.

    Attributes:
        queries_per_pair: Only the first queries of a pair take part, at most this number.
        max_distance_a_px: Largest distance of two neighbours in the source frame.
        min_distance_a_px: Smallest distance of two neighbours in the source frame.
        max_true_stretch: Neighbours that the truth stretches more are left out.
        jump_stretch: A jump stretches the distance by more than this factor.
        jump_min_px: A jump is also longer than this.
        quantile: Level of the reported quantile of the stretch.
    """

    queries_per_pair: Annotated[int, Bounds(2)]
    max_distance_a_px: Positive
    min_distance_a_px: Positive
    max_true_stretch: Positive
    jump_stretch: Positive
    jump_min_px: Annotated[float, Bounds(0)]
    quantile: Level


class Continuity(Metric[ContinuitySettings]):
    """Jump rate and local stretch of the answers of neighbouring queries."""

    Settings = ContinuitySettings
    query_pixels = True

    def __init__(self, settings: ContinuitySettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._stretch: list[FloatArray] = []

    def update(self, block: Block) -> None:
        """Take in one block."""
        if block.uv_a_px is None:
            return
        settings = self.settings
        row, other = nearest_neighbours(
            block.uv_a_px, block.counted, block.starts, settings.queries_per_pair
        )
        a, truth = _apart_px(block.uv_a_px, row, other), _apart_px(block.true_px, row, other)
        asked = (a >= settings.min_distance_a_px) & (a <= settings.max_distance_a_px)
        kept = np.flatnonzero(asked & (truth <= settings.max_true_stretch * a))
        row, other, a = row[kept], other[kept], a[kept]
        b = _apart_px(block.answer_px, row, other)
        jump = b > np.maximum(settings.jump_stretch * a, settings.jump_min_px)
        torn = block.lost[row] | block.lost[other]
        jump, b = jump | torn, np.where(torn, block.missing_px, b)
        pairs = len(block.starts) - 1
        pair = block.pair[row]
        self.table.put("neighbours", block.pairs, np.bincount(pair, minlength=pairs))
        self.table.put("jumps", block.pairs, np.bincount(pair, jump, pairs))
        self._stretch.append(b / a)

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the quantile of the stretch."""
        name = self.figures(self.settings)[1].name
        stretch, number = (
            np.concatenate([np.empty(0), *self._stretch]),
            self.table.columns["neighbours"],
        )
        for index, group in groups:
            parts = groups.parts(index, stretch, number)
            summary.set(group, name, *exact_quantiles(parts, [self.settings.quantile]))


def _apart_px(uv_px: RealArray, row: IntArray, other: IntArray) -> FloatArray:
    """Return the distance of the positions in two rows, float64 (K,)."""
    return endpoint_error_px(uv_px.take(row, axis=0), uv_px.take(other, axis=0))


def nearest_neighbours(
    uv_a_px: RealArray, usable: BoolArray, starts: IntArray, most: int
) -> tuple[IntArray, IntArray]:
    """Find the nearest usable other query of the same pair for each usable query.

    Args:
        uv_a_px: float (N, 2), query pixels.
        usable: bool (N,), queries that take part.
        starts: int64 (P + 1,), first row of each pair, and N.
        most: Only the first so many queries of a pair take part; the cost grows with its
            square.

    Returns:
        row, neighbour: int64 (K,) each, ascending in `row`; ties (in float32) go to the lower row.
    """
    rows: list[IntArray] = []
    neighbours: list[IntArray] = []
    size = np.minimum(np.diff(starts), most)
    for width in np.unique(size[size > 1]).tolist():
        begins = starts[:-1][size == width]
        step = max(1, _CHUNK_CELLS // (width * width))
        for first in range(0, len(begins), step):
            index = begins[first : first + step, None] + np.arange(width)  # (p, w)
            row, other = _nearest_in_blocks(uv_a_px, usable, index)
            rows.append(row)
            neighbours.append(other)
    if not rows:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    row = np.concatenate(rows)
    order = np.argsort(row, kind="stable")
    return row[order], np.concatenate(neighbours)[order]


def _nearest_in_blocks(
    uv_a_px: RealArray, usable: BoolArray, index: IntArray
) -> tuple[IntArray, IntArray]:
    uv = uv_a_px.take(index, axis=0).astype(np.float32)  # (p, w, 2), as queries are stored
    fine = usable[index]
    # An unusable query is moved so far away that it is nobody's nearest.
    u = np.where(fine, uv[..., 0], np.float32(1e9))
    v = uv[..., 1].copy()  # subtracting is faster in one piece
    squared = u[:, :, None] - u[:, None, :]
    squared *= squared
    dv = v[:, :, None] - v[:, None, :]
    dv *= dv
    squared += dv
    width = index.shape[1]
    squared.reshape(-1, width * width)[:, :: width + 1] = np.inf  # of each query to itself
    other = squared.argmin(axis=2) + width * np.arange(len(index))[:, None]
    both = np.flatnonzero(fine & fine.take(other))
    return index.take(both), index.take(other.take(both))
