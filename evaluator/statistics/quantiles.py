"""Exact quantiles of arrays with gaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.evaluator.arrays import FloatArray


def exact_quantiles(chunks: Sequence[FloatArray], levels: Sequence[float]) -> list[float | None]:
    """Return quantiles by linear interpolation between order statistics (numpy's `linear`).

    Args:
        chunks: float64 arrays, in memory or mapped; NaN is left out.
        levels: Levels from 0 to 1.

    Returns:
        One value per level; None where there are no values.
    """
    values = np.concatenate([np.empty(0), *(chunk[~np.isnan(chunk)] for chunk in chunks)])
    if not len(values):
        return [None] * len(levels)
    position = np.asarray(levels) * (len(values) - 1)
    below = np.floor(position).astype(np.int64)
    above = np.minimum(below + 1, len(values) - 1)
    values.partition(np.unique([below, above]))
    low, high = values[below], values[above]
    found: list[float | None] = (low + (high - low) * (position - below)).tolist()
    return found
