"""The metrics of TAP-Vid for one query frame and one target frame.

Source: Doersch et al., TAP-Vid: A Benchmark for Tracking Any Point in a Video, 2022, section 3,
and the function `compute_tapvid_metrics` published with it: positions scaled to 256x256, a
distance strictly below its threshold is within, averages taken in each video first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from pliant.evaluator.arrays import BoolArray, FloatArray, IntArray
from pliant.evaluator.metrics.base import Groups, Metric, Positive, Positives, Summary
from pliant.evaluator.metrics.pck import threshold_level
from pliant.evaluator.statistics.ratios import Figure, Ratio
from pliant.evaluator.submission.blocks import Block
from pliant.spec.configuration import configuration
from pliant.spec.constraints import Bounds, NotEmpty


@configuration(frozen=True)
class TapvidSettings:
    """Settings of `tapvid`.

    Attributes:
        thresholds: Distances in scaled pixels, ascending.
        comparison: `<` in the published definition.
        scale: Width and height that positions are scaled to.
        visible_threshold: Lowest probability that counts as predicted visible.
        visible_absent: What an answer without `visible` says.
    """

    thresholds: Annotated[Positives, NotEmpty()]
    comparison: Literal["<", "<="]
    scale: tuple[Positive, Positive]
    visible_threshold: Annotated[float, Bounds(0, 1)]
    visible_absent: Literal["all_visible"]


class Tapvid(Metric[TapvidSettings]):
    """Occlusion accuracy, delta_avg and average Jaccard of each image pair."""

    Settings = TapvidSettings

    @staticmethod
    def figures(settings: TapvidSettings) -> list[Figure]:
        """Return the averages over the thresholds, then the figures of each threshold."""
        mean = "mean over image pairs (TAP-Vid: over videos)"

        def higher(name: str, about: str, denominator: str, label: str = "") -> Ratio:
            about = f"{about}, {mean}"
            return Ratio(name, "higher", "", about, label, f"{name}_pair", denominator)

        within = "share of visible points within the thresholds, averaged over them"
        result: list[Figure] = [
            higher("oa", "occlusion accuracy", "one", "OA"),
            higher("delta_avg", within, "tapvid_pair", "δ avg"),
            higher("aj", "average Jaccard over the thresholds", "jaccard_pair", "AJ"),
        ]
        for t in settings.thresholds:
            about = f"share of visible points within {t:g} scaled px"
            result.append(higher(f"delta_{t:g}", about, "tapvid_pair"))
            result.append(higher(f"jaccard_{t:g}", f"Jaccard at {t:g} scaled px", "jaccard_pair"))
        return result

    def update(self, block: Block) -> None:
        """Take in one block."""
        settings = self.settings
        scale = np.array(settings.scale) / self.context.queries.size
        offset = (block.answer_px - block.true_px) * scale
        error = np.hypot(offset[:, 0], offset[:, 1])
        predicted = self.context.answers.visible
        if predicted is None:
            predicted_visible = np.ones(len(error), bool)
        else:
            predicted_visible = predicted[block.rows] >= settings.visible_threshold
        right = predicted_visible == block.counted
        if block.missing is not None:
            error = np.where(block.missing, np.inf, error)
            predicted_visible |= block.missing  # a false positive at every threshold
            right &= ~block.missing
        found = tapvid_pairs(
            error, block.counted, predicted_visible, right, block.pair, len(block.starts) - 1,
            settings.thresholds, settings.comparison,
        )  # fmt: skip
        has_visible = found.visible > 0
        has_jaccard = np.isfinite(found.jaccard).all(axis=1)
        columns = {
            "oa_pair": found.occlusion_accuracy,
            "tapvid_pair": has_visible,
            "jaccard_pair": has_jaccard,
            "delta_avg_pair": np.where(has_visible, found.points_within.mean(axis=1), 0),
            "aj_pair": np.where(has_jaccard, found.jaccard.mean(axis=1), 0),
        }
        for index, t in enumerate(settings.thresholds):
            within, jaccard = found.points_within[:, index], found.jaccard[:, index]
            columns[f"delta_{t:g}_pair"] = np.where(has_visible, within, 0)
            columns[f"jaccard_{t:g}_pair"] = np.where(has_jaccard, jaccard, 0)
        for name, values in columns.items():
            self.table.put(name, block.pairs, np.nan_to_num(values))

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Say what was assumed."""
        if self.context.answers.visible is None:
            summary.notes["visible"] = (
                "the submission has no column `visible`: every point was taken as predicted visible"
            )


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
