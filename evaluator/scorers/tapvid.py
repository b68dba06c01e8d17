"""TAP-Vid's figures for each image pair."""

from __future__ import annotations

import numpy as np

from pliant.evaluator.metrics.tapvid import tapvid_pairs
from pliant.evaluator.scorers.base import Groups, Scorer, Summary
from pliant.evaluator.statistics.ratios import threshold_name
from pliant.evaluator.submission.blocks import Block


class TapvidScorer(Scorer):
    """Occlusion accuracy, delta_avg and average Jaccard."""

    def update(self, block: Block) -> None:
        """Take in one block."""
        width, height = self.context.queries.size
        scale_u, scale_v = self.settings["scale"][0] / width, self.settings["scale"][1] / height
        offset = block.answer_px - block.true_px
        error = np.hypot(offset[:, 0] * scale_u, offset[:, 1] * scale_v)
        visible = block.counted
        predicted = self.context.answers.visible
        if predicted is None:
            predicted_visible = np.ones(len(error), bool)
        else:
            predicted_visible = predicted[block.rows] >= self.settings["visible_threshold"]
        right = predicted_visible == visible
        if block.missing is not None:
            error = np.where(block.missing, np.inf, error)
            predicted_visible |= block.missing  # a false positive at every threshold
            right &= ~block.missing
        thresholds = self.settings["thresholds"]
        pairs = len(block.starts) - 1
        figures = tapvid_pairs(
            error, visible, predicted_visible, right, block.pair, pairs, thresholds,
            self.settings["comparison"],
        )  # fmt: skip

        def put(name: str, values: np.ndarray) -> None:  # type: ignore[type-arg]
            self.table.put(name, block.pairs, np.nan_to_num(values))

        has_visible = figures.visible > 0
        has_jaccard = np.isfinite(figures.jaccard).all(axis=1)
        put("oa_pair", figures.occlusion_accuracy)
        put("tapvid_pair", has_visible)
        put("jaccard_pair", has_jaccard)
        put("delta_avg_pair", np.where(has_visible, figures.points_within.mean(axis=1), 0))
        put("aj_pair", np.where(has_jaccard, figures.jaccard.mean(axis=1), 0))
        for index, threshold in enumerate(thresholds):
            t = threshold_name(threshold)
            put(f"delta_{t}_pair", np.where(has_visible, figures.points_within[:, index], 0))
            put(f"jaccard_{t}_pair", np.where(has_jaccard, figures.jaccard[:, index], 0))

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Say what was assumed."""
        if self.context.answers.visible is None:
            summary.notes["visible"] = (
                "the submission has no column `visible`: every point was taken as predicted visible"
            )
