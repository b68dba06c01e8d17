"""How far an answer is from the truth, in pixels; sums for averages, and exact quantiles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray, IntArray, RealArray


def endpoint_error_px(
    predicted_px: RealArray, true_px: RealArray, scale: Sequence[float] | FloatArray = (1, 1)
) -> FloatArray:
    """Return the Euclidean distance of each answer from its truth.

    Args:
        predicted_px: float (N, 2), pixels.
        true_px: float (N, 2), pixels.
        scale: Factors of both axes.

    Returns:
        float64 (N,), pixels.
    """
    squared = squared_error_px2(predicted_px, true_px, scale)
    return np.sqrt(squared, out=squared)


def squared_error_px2(
    predicted_px: RealArray, true_px: RealArray, scale: Sequence[float] | FloatArray = (1, 1)
) -> FloatArray:
    """Return the squared Euclidean distance of each answer from its truth.

    Args:
        predicted_px: float (N, 2), pixels.
        true_px: float (N, 2), pixels.
        scale: Factors of both axes.

    Returns:
        float64 (N,), square pixels.
    """
    du = np.subtract(predicted_px[:, 0], true_px[:, 0], dtype=np.float64)
    dv = np.subtract(predicted_px[:, 1], true_px[:, 1], dtype=np.float64)
    if tuple(scale) != (1, 1):
        du *= scale[0]
        dv *= scale[1]
    du *= du
    dv *= dv
    du += dv
    return du


def sum_by_pair(values: npt.NDArray[Any], starts: IntArray) -> FloatArray:
    """Return the sum of consecutive values for each image pair.

    Args:
        values: float64 (N,), or bool or integers (N,), which are counted.
        starts: int64 (P,), ascending, the first row of each pair; no pair is empty.

    Returns:
        float64 (P,).
    """
    if values.dtype != np.float64:
        values = values.astype(np.float64)
    sums: FloatArray = np.add.reduceat(values, starts)
    return sums


def rmse_px(error_px: FloatArray) -> float:
    """Return the root of the mean squared error, pixels; NaN for no errors.

    Args:
        error_px: float64 (N,), pixels.
    """
    return float(np.sqrt(np.mean(error_px**2))) if len(error_px) else float("nan")


def exact_quantiles(chunks: Sequence[FloatArray], levels: Sequence[float]) -> list[float | None]:
    """Return quantiles by linear interpolation between order statistics (numpy's `linear`).

    Args:
        chunks: float64 arrays without NaN.
        levels: Levels from 0 to 1.

    Returns:
        One value per level; None where there are no values.
    """
    values = np.concatenate([np.empty(0), *chunks])
    if not len(values):
        return [None] * len(levels)
    position = np.asarray(levels) * (len(values) - 1)
    below = np.floor(position).astype(np.int64)
    above = np.minimum(below + 1, len(values) - 1)
    values.partition(np.unique([below, above]))
    low, high = values[below], values[above]
    found: list[float | None] = (low + (high - low) * (position - below)).tolist()
    return found
