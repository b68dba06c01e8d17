"""Answers within thresholds, in pixels and in shares of the object's box."""

from __future__ import annotations

from typing import Any, ClassVar

from pliant.evaluator.arrays import IntArray
from pliant.evaluator.metrics.pck import threshold_level, within_by_pair
from pliant.evaluator.scorers.base import Scorer
from pliant.evaluator.statistics.ratios import threshold_name
from pliant.evaluator.submission.blocks import Block


class PckScorer(Scorer):
    """PCK over the queries visible in the target frame."""

    truth_columns: ClassVar[tuple[str, ...]] = ("box_px",)

    def update(self, block: Block) -> None:
        """Take in one block."""
        comparison = self.settings["comparison"]
        thresholds = self.settings["thresholds_px"]
        level = threshold_level(block.reach_px, thresholds, comparison)
        self._put(block, level, thresholds, "px")
        thresholds = self.settings["thresholds_box"]
        if thresholds and block.box_px is not None:
            level = threshold_level(block.reach_px / block.box_px, thresholds, comparison)
            self._put(block, level, thresholds, "box")

    def _put(self, block: Block, level: IntArray, thresholds: list[Any], unit: str) -> None:
        pairs = len(block.starts) - 1
        counted = block.counted
        counts = within_by_pair(level[counted], block.pair[counted], pairs, len(thresholds))
        for index, threshold in enumerate(thresholds):
            name = f"within_{threshold_name(threshold)}{unit}"
            self.table.put(name, block.pairs, counts[:, index])
