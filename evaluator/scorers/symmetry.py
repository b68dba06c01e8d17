"""Errors with the object's symmetries forgiven, and how often one was needed."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from pliant.evaluator.metrics.localisation import sum_by_pair
from pliant.evaluator.metrics.symmetry import symmetric_errors
from pliant.evaluator.scorers.base import Groups, Scorer, Summary
from pliant.evaluator.submission.blocks import Block


class SymmetryScorer(Scorer):
    """Symmetry-aware RMSE by pair and by point, and flip rates."""

    truth_columns: ClassVar[tuple[str, ...]] = ("alternatives",)

    def update(self, block: Block) -> None:
        """Take in one block."""
        partners = block.partners
        if partners is None:
            return
        starts = block.starts[:-1]
        pairs = len(starts)
        counted = block.counted
        own = np.where(counted, block.squared_px2, 0.0)
        pair_squared = sum_by_pair(own, starts)
        point_squared = pair_squared.copy()
        flipped_pairs, flipped_points = np.zeros(pairs), np.zeros(pairs)
        asked_pairs, asked_points = np.zeros(pairs), np.zeros(pairs)
        each = np.diff(partners.begin)
        if each.any():
            # Pairs of one tier share their number of symmetries. A missing answer is flipped.
            lost = np.zeros(len(own), bool) if block.missing is None else block.missing & counted
            lost_points = sum_by_pair(lost, starts)
            for count in np.unique(each[starts]).tolist():
                chosen = np.flatnonzero(each[starts] == count)
                if not count or not len(chosen):
                    continue
                rows = np.flatnonzero(np.isin(block.pair, chosen))
                size = np.diff(block.starts)[chosen]
                begin = np.cumsum(size) - size
                index = partners.begin[rows, None] + np.arange(count)
                result = symmetric_errors(
                    block.answer_px[rows],
                    block.squared_px2[rows],
                    partners.uv_px[index],
                    partners.visible[index],
                    counted[rows],
                    begin,
                )
                asked = sum_by_pair(counted[rows], begin)
                pair_squared[chosen] = result.pair_squared_px2
                point_squared[chosen] = sum_by_pair(result.point_squared_px2, begin)
                flipped_pairs[chosen] = result.pair_flipped | (lost_points[chosen] > 0)
                flipped_points[chosen] = (
                    sum_by_pair(result.point_flipped, begin) + lost_points[chosen]
                )
                asked_points[chosen] = asked
                asked_pairs[chosen] = asked > 0
        put = self.table.put
        put("symmetric_squared_px2", block.pairs, pair_squared)
        put("point_symmetric_squared_px2", block.pairs, point_squared)
        put("flipped_pairs", block.pairs, flipped_pairs)
        put("symmetric_pairs", block.pairs, asked_pairs)
        put("flipped_points", block.pairs, flipped_points)
        put("symmetric_points", block.pairs, asked_points)

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Say where flips are not defined."""
        blank = [n for n, tier in self.context.dataset.tiers.items() if not tier.symmetries]
        asked = [name for name in groups.names if name in blank]
        if asked:
            summary.notes["flip_rate"] = f"tiers without symmetries: {', '.join(asked)}"
