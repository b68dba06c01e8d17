"""Exact quantiles of long arrays in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from pliant.evaluator.arrays import FloatArray, IntArray

_CHUNK: Final = 1 << 18
_CELLS: Final = 4096
_SELECT: Final = 1 << 23
"""Up to so many values are simply copied and partitioned."""
_COLLECT: Final = 1 << 21
"""So many values are looked at in one piece."""


def exact_quantiles(chunks: Sequence[FloatArray], levels: Sequence[float]) -> list[float | None]:
    """Return quantiles by linear interpolation between order statistics (numpy's `linear`).

    Many values are counted into cells, and only the cells that hold a wanted order statistic
    are looked into, again by cells if there are too many: memory does not grow with the number
    of values, and nothing is approximated.

    Args:
        chunks: float64 arrays, in memory or mapped; NaN is left out.
        levels: Levels from 0 to 1.

    Returns:
        One value a level; None where there are no values.
    """
    count = 0
    low, high = np.inf, -np.inf
    for values in _pieces(chunks):
        count += len(values)
        if len(values):
            low, high = min(low, values.min()), max(high, values.max())
    if not count:
        return [None] * len(levels)
    positions = np.asarray(levels, np.float64) * (count - 1)
    below = np.floor(positions).astype(np.int64)
    above = np.minimum(below + 1, count - 1)
    wanted = np.unique(np.concatenate([below, above]))
    if count <= _SELECT:
        values = np.concatenate(list(_pieces(chunks)))
        values.partition(wanted)
        statistics = values[wanted].tolist()
    else:
        statistics = _order_statistics(chunks, low, high, wanted)
    found = dict(zip(wanted.tolist(), statistics, strict=True))
    result: list[float | None] = []
    for position, lower, upper in zip(positions, below.tolist(), above.tolist(), strict=True):
        share = position - lower
        result.append(float(found[lower] + (found[upper] - found[lower]) * share))
    return result


def _order_statistics(
    chunks: Sequence[FloatArray], low: float, high: float, wanted: IntArray
) -> list[float]:
    """Return the values at the ascending ranks `wanted` among those in [low, high]."""
    if low == high:
        return [low] * len(wanted)
    scale = _CELLS / (high - low)
    if not np.isfinite(scale):
        return np.sort(_between(chunks, low, high))[wanted].tolist()
    counts = np.zeros(_CELLS, np.int64)
    for values in _pieces(chunks):
        inside = values[(values >= low) & (values <= high)]
        counts += np.bincount(_cell(inside, low, scale), minlength=_CELLS)
    ends = np.cumsum(counts)
    result: list[float] = []
    cells = np.searchsorted(ends, wanted, side="right")
    for cell in np.unique(cells).tolist():
        ranks = wanted[cells == cell] - (ends[cell] - counts[cell])
        members, least, most = _members(chunks, low, high, scale, cell, int(counts[cell]))
        if members is not None:
            members.sort()
            result += members[ranks].tolist()
        else:
            result += _order_statistics(chunks, least, most, ranks)
    return result


def _cell(values: FloatArray, low: float, scale: float) -> IntArray:
    return np.minimum((values - low) * scale, _CELLS - 1).astype(np.int64)


def _members(
    chunks: Sequence[FloatArray], low: float, high: float, scale: float, cell: int, count: int
) -> tuple[FloatArray | None, float, float]:
    """Return the values of one cell, or, if they are too many, only their range."""
    collected: list[FloatArray] = []
    least, most = np.inf, -np.inf
    # A window slightly wider than the cell: the exact test runs on few values only.
    left = low + (cell - 0.01) / scale
    right = low + (cell + 1.01) / scale
    for values in _pieces(chunks):
        near = values[(values >= max(left, low)) & (values <= min(right, high))]
        inside = near[_cell(near, low, scale) == cell]
        if not len(inside):
            continue
        if count <= _COLLECT:
            collected.append(inside)
        least, most = min(least, inside.min()), max(most, inside.max())
    if count <= _COLLECT:
        return np.concatenate(collected), least, most
    return None, least, most


def _between(chunks: Sequence[FloatArray], low: float, high: float) -> FloatArray:
    return np.concatenate([v[(v >= low) & (v <= high)] for v in _pieces(chunks)])


def _pieces(chunks: Sequence[FloatArray]) -> Iterator[FloatArray]:
    for chunk in chunks:
        for begin in range(0, len(chunk), _CHUNK):
            piece = np.asarray(chunk[begin : begin + _CHUNK], np.float64)
            missing = np.isnan(piece)
            yield piece[~missing] if missing.any() else piece
