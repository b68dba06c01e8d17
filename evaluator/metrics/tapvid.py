"""The metrics of TAP-Vid for one query frame and one target frame.

Source: Doersch et al., TAP-Vid: A Benchmark for Tracking Any Point in a Video, 2022, section 3,
and the function `compute_tapvid_metrics` published with it: positions scaled to 256x256, a
distance strictly below its threshold is within, averages taken in each video first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

import numpy as np

from pliant.evaluator.metrics.base import (
    Groups,
    Metric,
    Positive,
    Positives,
    Summary,
    listed_figures,
)
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.errors import endpoint_error_px
from pliant.evaluator.metrics.pck import threshold_level
from pliant.evaluator.statistics.ratios import Figure
from pliant.spec.arrays import BoolArray, FloatArray, IntArray
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds, NotEmpty


class TapvidSettings(Settings):
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

    @classmethod
    def figures(cls, settings: TapvidSettings) -> list[Figure]:
        """Return the averages over the thresholds, then the figures of each threshold."""
        mean = "mean over image pairs (TAP-Vid: over videos)"
        return listed_figures("tapvid", settings, mean=mean, one="one")

    def update(self, block: Block) -> None:
        """Take in one block."""
        for name, values in self.counts(block).columns(self.settings.thresholds).items():
            self.table.put(name, block.pairs, values)

    def counts(self, block: Block) -> TapvidPairs:
        """Return what is counted in each pair of a block."""
        error, predicted_visible, right = self.judged(block)
        pairs = len(block.starts) - 1
        return tapvid_pairs(
            error, block.counted, predicted_visible, right, block.pair, pairs, self.settings
        )

    def judged(self, block: Block) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Judge each query of a block.

        Returns:
            Its distance in scaled pixels, float64 (N,), inf for a missing answer; whether it is
            predicted visible, bool (N,), as a missing answer is; and whether that is right.
        """
        settings = self.settings
        scale = np.array(settings.scale) / self.context.queries.size
        error = endpoint_error_px(block.answer_px, block.true_px, scale)
        predicted = self.context.answers.visible
        if predicted is None:
            predicted_visible = np.ones(len(error), bool)
        else:
            predicted_visible = predicted[block.rows] >= settings.visible_threshold
        right = (predicted_visible == block.counted) & ~block.lost
        if block.missing is not None:
            error[block.missing] = np.inf
        # A missing answer is a false positive at every threshold.
        return error, predicted_visible | block.lost, right

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Say what was assumed."""
        if self.context.answers.visible is None:
            summary.notes["visible"] = (
                "the submission has no column `visible`: every point was taken as predicted visible"
            )


@dataclass(frozen=True)
class TapvidPairs:
    """What TAP-Vid counts in each image pair, or in each video, and the figures that follow.

    Attributes:
        queries: int64 (P,).
        right: int64 (P,), queries whose visibility is predicted right.
        visible: int64 (P,), queries truly visible.
        within: int64 (P, T), the visible within each threshold.
        true_positives, false_positives: int64 (P, T).
    """

    queries: IntArray
    right: IntArray
    visible: IntArray
    within: IntArray
    true_positives: IntArray
    false_positives: IntArray

    @property
    def occlusion_accuracy(self) -> FloatArray:
        """float64 (P,), share of queries whose visibility is predicted right; NaN for none."""
        return _quotient(self.right, self.queries)

    @cached_property
    def points_within(self) -> FloatArray:
        """float64 (P, T), share of the visible within each threshold; NaN for none visible."""
        return _quotient(self.within, self.visible[:, None])

    @cached_property
    def jaccard(self) -> FloatArray:
        """float64 (P, T), true positives over themselves, false positives and false negatives."""
        return _quotient(self.true_positives, self.visible[:, None] + self.false_positives)

    def columns(self, thresholds: Sequence[float]) -> dict[str, FloatArray]:
        """Return the columns of the pair table that the figures divide, 0 for NaN."""
        has_jaccard = np.isfinite(self.jaccard).all(axis=1)
        columns = {
            "oa_pair": self.occlusion_accuracy,
            "tapvid_pair": self.visible > 0,
            "jaccard_pair": has_jaccard,
            "delta_avg_pair": self.points_within.mean(axis=1),
            "aj_pair": np.where(has_jaccard, self.jaccard.mean(axis=1), 0),
        }
        for index, t in enumerate(thresholds):
            columns[f"delta_{t:g}_pair"] = self.points_within[:, index]
            columns[f"jaccard_{t:g}_pair"] = np.where(has_jaccard, self.jaccard[:, index], 0)
        return {name: np.nan_to_num(values.astype(np.float64)) for name, values in columns.items()}


def _quotient(above: IntArray, below: IntArray) -> FloatArray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(above / below, np.float64)


def tapvid_pairs(
    scaled_error: FloatArray,
    visible: BoolArray,
    predicted_visible: BoolArray,
    right: BoolArray,
    pair: IntArray,
    pairs: int,
    settings: TapvidSettings,
) -> TapvidPairs:
    """Compute TAP-Vid's figures for each pair.

    A visible prediction of a visible point within the threshold is a true positive. A visible
    prediction is a false positive if the point is hidden or the distance is not within. A
    visible point that is not a true positive is a false negative; true positives and false
    negatives together are the visible points.

    Args:
        scaled_error: float64 (N,), distances in scaled pixels; inf for a missing answer.
        visible: bool (N,), the truth.
        predicted_visible: bool (N,).
        right: bool (N,), whether the visibility counts as predicted right (a missing answer
            never does).
        pair: int64 (N,), 0 to `pairs` - 1, every pair present.
        pairs: Number of pairs, P.
        settings: T thresholds, and how a distance equal to one counts.

    Returns:
        What is counted in each pair.
    """
    count = len(settings.thresholds)
    width = count + 1
    level = threshold_level(scaled_error, settings.thresholds, settings.comparison)
    # Of visible, predicted visible and right: small numbers before they become keys.
    judged = 4 * visible.view(np.uint8) + 2 * predicted_visible.view(np.uint8) + right
    key = (pair * width + level) * 8 + judged
    cells = np.bincount(key, minlength=pairs * width * 8).reshape(pairs, width, 2, 2, 2)
    is_right, cells = cells[..., 1].sum(axis=(1, 2, 3)), cells.sum(axis=4)
    within = np.cumsum(cells, axis=1)[:, :count]  # (P, T, visible, predicted visible)
    total = cells.sum(axis=1)  # (P, visible, predicted visible)
    is_visible = total[:, 1].sum(axis=1)
    true_positives = within[:, :, 1, 1]
    false_positives = total[:, :, 1].sum(axis=1)[:, None] - true_positives
    return TapvidPairs(
        queries=total.sum(axis=(1, 2)),
        right=is_right,
        visible=is_visible,
        within=within[:, :, 1].sum(axis=2),
        true_positives=true_positives,
        false_positives=false_positives,
    )
