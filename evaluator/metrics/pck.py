"""Percentage of correct keypoints: the share of answers within a distance of the truth.

Source: Yang and Ramanan, Articulated Human Detection with Flexible Mixtures of Parts, 2013,
section 6: within alpha times the longer side of the object's box. Pliant also takes distances
in pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from pliant.evaluator.metrics.base import Metric, Positives
from pliant.evaluator.metrics.blocks import Block
from pliant.spec.arrays import FloatArray, IntArray
from pliant.spec.configuration import Settings


class PckSettings(Settings):
    """Settings of `pck`.

    Attributes:
        thresholds_px: Distances in pixels, ascending.
        thresholds_box: Shares of the longer side of the object's visible box, ascending.
        comparison: `<=`: a distance equal to a threshold is within it.
    """

    thresholds_px: Positives
    thresholds_box: Positives
    comparison: Literal["<", "<="]


class Pck(Metric[PckSettings]):
    """PCK over the queries visible in the target frame."""

    Settings = PckSettings
    truth_columns = ("box_px",)

    def update(self, block: Block) -> None:
        """Take in one block."""
        reach = block.reach_px.take(block.counted_rows)
        self._count(block, reach, self.settings.thresholds_px, "px")
        if block.box_px is not None:
            share = reach / block.box_px.take(block.counted_rows)
            self._count(block, share, self.settings.thresholds_box, "box")

    def _count(
        self, block: Block, distance: FloatArray, thresholds: Sequence[float], suffix: str
    ) -> None:
        level = threshold_level(distance, thresholds, self.settings.comparison)
        pairs, width = len(block.starts) - 1, len(thresholds) + 1
        key = block.counted_pair * width + level
        counts = np.bincount(key, minlength=pairs * width).reshape(pairs, width).cumsum(axis=1)
        for index, threshold in enumerate(thresholds):
            self.table.put(f"within_{threshold:g}{suffix}", block.pairs, counts[:, index])


def threshold_level(distance: FloatArray, thresholds: Sequence[float], comparison: str) -> IntArray:
    """Return the first threshold each distance is within.

    Args:
        distance: float64 (N,), any unit.
        thresholds: T ascending thresholds, the same unit.
        comparison: `<` or `<=`: whether a distance equal to a threshold is within it.

    Returns:
        int64 (N,): index into `thresholds`, or T where the distance is within none.
    """
    # Thresholds are few: counting those that are failed is faster than searching.
    level = np.zeros(len(distance), np.min_scalar_type(len(thresholds)))
    for threshold in thresholds:
        within = distance <= threshold if comparison == "<=" else distance < threshold
        level += (~within).view(np.uint8)
    return level.astype(np.int64)
