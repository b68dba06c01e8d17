"""Whether neighbours stay neighbours: jumps and local stretch.

The paper speaks of "large discontinuous jumps" between the answers of neighbouring pixels. Here
a neighbour is the nearest other query of the source frame, and a pair of neighbours is asked
only where the truth itself keeps them together.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.evaluator.arrays import BoolArray, FloatArray, IntArray, RealArray

_CHUNK_CELLS: Final = 1 << 19
"""Distances computed at once; they stay in the processor's cache."""


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
    uv = uv_a_px[index].astype(np.float32)  # (p, w, 2), the precision queries are stored in
    fine = usable[index]
    # An unusable query is moved so far away that it is nobody's nearest.
    u = np.where(fine, uv[..., 0], np.float32(1e9))
    v = uv[..., 1]
    squared = u[:, :, None] - u[:, None, :]
    squared *= squared
    dv = v[:, :, None] - v[:, None, :]
    dv *= dv
    squared += dv
    width = index.shape[1]
    squared[:, np.arange(width), np.arange(width)] = np.inf
    nearest = squared.argmin(axis=2)
    both = fine & np.take_along_axis(fine, nearest, axis=1)
    return index[both], np.take_along_axis(index, nearest, axis=1)[both]


def distance_px(uv_px: RealArray, row: IntArray, other: IntArray) -> FloatArray:
    """Return the distances between positions, float64 (K,).

    Args:
        uv_px: float (N, 2), pixels.
        row: int64 (K,), rows.
        other: int64 (K,), rows.
    """
    offset = uv_px[row].astype(np.float64) - uv_px[other]
    return np.sqrt(np.einsum("nk,nk->n", offset, offset))


def is_jump(
    distance_a_px: FloatArray, distance_b_px: FloatArray, stretch: float, least_px: float
) -> npt.NDArray[np.bool_]:
    """Return which pairs of neighbours the answers tear apart.

    Args:
        distance_a_px: float64 (K,), between the queries.
        distance_b_px: float64 (K,), between their answers.
        stretch: A jump is longer than so many times the distance in the source frame …
        least_px: … and longer than this.
    """
    return distance_b_px > np.maximum(stretch * distance_a_px, least_px)
