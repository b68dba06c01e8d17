"""Jumps and local stretch between neighbouring queries."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from pliant.evaluator.metrics.continuity import distance_px, is_jump, nearest_neighbours
from pliant.evaluator.scorers.base import Groups, Scorer, ScoringContext, Summary
from pliant.evaluator.statistics.quantiles import exact_quantiles
from pliant.evaluator.submission.blocks import Block


class ContinuityScorer(Scorer):
    """Whether the answers keep together what the truth keeps together."""

    query_pixels: ClassVar[bool] = True

    def __init__(self, settings: Mapping[str, Any], context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._stretch = context.scratch.full(context.queries.rows, np.float64, np.nan)

    def update(self, block: Block) -> None:
        """Take in one block."""
        if block.uv_a_px is None:
            return
        settings = self.settings
        row, other = nearest_neighbours(
            block.uv_a_px, block.counted, block.starts, settings["queries_per_pair"]
        )
        a = distance_px(block.uv_a_px, row, other)
        truth = distance_px(block.true_px, row, other)
        asked = (
            (a >= settings["min_distance_a_px"])
            & (a <= settings["max_distance_a_px"])
            & (truth <= settings["max_true_stretch"] * a)
        )
        row, other, a = row[asked], other[asked], a[asked]
        b = distance_px(block.answer_px, row, other)
        jump = is_jump(a, b, settings["jump_stretch"], settings["jump_min_px"])
        if block.missing is not None:
            torn = block.missing[row] | block.missing[other]
            jump, b = jump | torn, np.where(torn, block.missing_px, b)
        pairs = len(block.starts) - 1
        pair = block.pair[row]
        self.table.put("neighbours", block.pairs, np.bincount(pair, minlength=pairs))
        self.table.put("jumps", block.pairs, np.bincount(pair, jump, pairs))
        self._stretch[block.first_row + row] = b / a

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the quantile of the stretch."""
        level = self.settings["quantile"]
        for index, name in groups:
            (value,) = exact_quantiles(groups.rows(index, self._stretch), [level])
            summary.set(name, f"stretch_p{level * 100:g}", value)
