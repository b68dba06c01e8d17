"""Calibration and sparsification: does the stated uncertainty order and size the errors?

Sources: Guo et al., On Calibration of Modern Neural Networks, 2017, equation 3 (ECE); Ilg et
al., Uncertainty Estimates and Multi-Hypotheses Networks for Optical Flow, 2018, section 5
(sparsification and AUSE).
"""

from __future__ import annotations

import numpy as np

from pliant.spec.arrays import BoolArray, FloatArray, IntArray


def reliability_bins(confidence: FloatArray, happened: BoolArray, bins: int) -> FloatArray:
    """Sum up predictions in equal bins of their confidence.

    Args:
        confidence: float64 (N,), predicted probabilities, 0 to 1.
        happened: bool (N,), whether it was so.
        bins: Number of bins, B; bin i holds i / B < confidence <= (i + 1) / B, the first also 0.

    Returns:
        float64 (B, 3): predictions, sum of confidence, number that happened.
    """
    index = np.maximum(np.ceil(confidence * bins).astype(np.int64) - 1, 0)
    return np.stack(
        [
            np.bincount(index, minlength=bins).astype(np.float64),
            np.bincount(index, confidence, bins),
            np.bincount(index, happened, bins),
        ],
        axis=1,
    )


def expected_calibration_error(table: FloatArray) -> float:
    """Return the mean gap between confidence and frequency, weighted by the bins' size.

    Args:
        table: float64 (B, 3), from `reliability_bins`; sums of several are fine.
    """
    total = table[:, 0].sum()
    return float(np.abs(table[:, 1] - table[:, 2]).sum() / total) if total else float("nan")


def sparsification(squared_error_px2: FloatArray, order_by: FloatArray, steps: int) -> FloatArray:
    """Return the RMSE that is left when the most uncertain share is removed.

    Answers of equal uncertainty are removed in equal parts, so that their order does not matter.

    Args:
        squared_error_px2: float64 (N,), N >= 1.
        order_by: float64 (N,), uncertainty; the highest is removed first.
        steps: Number of shares, S: 0, 1 / S, … (S - 1) / S.

    Returns:
        float64 (S,), RMSE of what remains, pixels.
    """
    _, group, size = np.unique(order_by, return_inverse=True, return_counts=True)
    held = np.concatenate([[0.0], np.cumsum(np.bincount(group, squared_error_px2))])
    rows = np.concatenate([[0], np.cumsum(size)])
    keep = len(order_by) * (1 - np.arange(steps) / steps)
    return np.sqrt(np.interp(keep, rows, held) / keep)


def area_under_sparsification_error(by_uncertainty: FloatArray, by_error: FloatArray) -> float:
    """Return AUSE: the area between the curve and the oracle's, both divided by the full RMSE.

    Args:
        by_uncertainty: float64 (S,), `sparsification` by the stated uncertainty.
        by_error: float64 (S,), `sparsification` by the error itself.

    Returns:
        0 for a perfect order; 0 also where every error is 0. The area is taken by the
        trapezoidal rule over the removed share from 0 to (S - 1) / S.
    """
    if by_uncertainty[0] == 0:
        return 0.0
    gap = (by_uncertainty - by_error) / by_uncertainty[0]
    return float(np.sum((gap[1:] + gap[:-1]) / 2) / len(gap))


def reliability_curve(table: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return (bin, mean confidence, frequency) of the bins that are not empty."""
    used = np.flatnonzero(table[:, 0])
    return used, table[used, 1] / table[used, 0], table[used, 2] / table[used, 0]
