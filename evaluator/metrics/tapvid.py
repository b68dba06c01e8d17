"""The metrics of TAP-Vid for one query frame and one target frame.

Source: Doersch et al., TAP-Vid: A Benchmark for Tracking Any Point in a Video, 2022, section 3,
and the function `compute_tapvid_metrics` published with it: positions scaled to 256x256, a
distance strictly below its threshold is within, averages taken in each video first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pliant.evaluator.arrays import BoolArray, FloatArray, IntArray
from pliant.evaluator.metrics.pck import threshold_level


@dataclass(frozen=True)
class TapvidPairs:
    """TAP-Vid's figures of each pair; NaN where the pair does not define one.

    Attributes:
        occlusion_accuracy: float64 (P,), share of queries whose visibility is predicted right.
        points_within: float64 (P, T), share of the visible within each threshold.
        jaccard: float64 (P, T), true positives over true positives, false positives and false
            negatives at each threshold.
        true_positives, false_positives: int64 (P, T).
        visible: int64 (P,), queries truly visible.
    """

    occlusion_accuracy: FloatArray
    points_within: FloatArray
    jaccard: FloatArray
    true_positives: IntArray
    false_positives: IntArray
    visible: IntArray


def tapvid_pairs(
    scaled_error: FloatArray,
    visible: BoolArray,
    predicted_visible: BoolArray,
    right: BoolArray,
    pair: IntArray,
    pairs: int,
    thresholds: Sequence[float],
    comparison: str = "<",
) -> TapvidPairs:
    """Compute TAP-Vid's figures for each pair.

    A visible prediction of a visible point within the threshold is a true positive. A visible
    prediction is a false positive if the point is hidden or the distance is not within. A
    visible point that is no true positive is a false negative; true positives and false
    negatives together are the visible points.

    Args:
        scaled_error: float64 (N,), distances in scaled pixels; inf for a missing answer.
        visible: bool (N,), the truth.
        predicted_visible: bool (N,).
        right: bool (N,), whether the visibility counts as predicted right (a missing answer
            never does).
        pair: int64 (N,), 0 to `pairs` - 1, every pair present.
        pairs: Number of pairs, P.
        thresholds: T ascending thresholds in scaled pixels.
        comparison: `<` in the published definition.

    Returns:
        The figures of each pair.
    """
    count = len(thresholds)
    width = count + 1
    level = threshold_level(scaled_error, thresholds, comparison)
    key = ((pair * width + level) * 2 + visible) * 2 + predicted_visible
    cells = np.bincount(key, minlength=pairs * width * 4).reshape(pairs, width, 2, 2)
    within = np.cumsum(cells, axis=1)[:, :count]  # (P, T, visible, predicted visible)
    total = cells.sum(axis=1)  # (P, visible, predicted visible)
    is_visible = total[:, 1].sum(axis=1)
    true_positives = within[:, :, 1, 1]
    false_positives = total[:, :, 1].sum(axis=1)[:, None] - true_positives
    queries = total.sum(axis=(1, 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        return TapvidPairs(
            occlusion_accuracy=np.bincount(pair, right, pairs) / queries,
            points_within=within[:, :, 1].sum(axis=2) / is_visible[:, None],
            jaccard=true_positives / (is_visible[:, None] + false_positives),
            true_positives=true_positives,
            false_positives=false_positives,
            visible=is_visible,
        )
