"""Errors in pixels: their sums for each pair, and their quantiles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from pliant.evaluator.metrics.localisation import sum_by_pair
from pliant.evaluator.scorers.base import Groups, Scorer, ScoringContext, Summary
from pliant.evaluator.statistics.quantiles import exact_quantiles
from pliant.evaluator.submission.blocks import Block

_NAMES: Final = {0.5: "median_px", 0.95: "p95_px"}


class CountScorer(Scorer):
    """How many queries there are, how many are counted, how many answered: for every protocol."""

    def update(self, block: Block) -> None:
        """Take in one block."""
        starts, pairs = block.starts[:-1], block.pairs
        queries = np.diff(block.starts)
        missing = 0 if block.missing is None else sum_by_pair(block.missing, starts)
        self.table.put("queries", pairs, queries)
        self.table.put("counted", pairs, sum_by_pair(block.counted, starts))
        self.table.put("answered", pairs, queries - missing)


class LocalisationScorer(Scorer):
    """RMSE, mean and quantiles of the error over the queries visible in the target frame."""

    def __init__(self, settings: Mapping[str, Any], context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._levels: list[float] = list(settings["quantiles"])
        self._errors = (
            context.scratch.full(context.queries.rows, np.float64, np.nan) if self._levels else None
        )

    def update(self, block: Block) -> None:
        """Take in one block."""
        starts, counted = block.starts[:-1], block.counted
        put, pairs = self.table.put, block.pairs
        put(
            "sum_squared_px2", pairs, sum_by_pair(np.where(counted, block.squared_px2, 0.0), starts)
        )
        put("sum_error_px", pairs, sum_by_pair(np.where(counted, block.error_px, 0.0), starts))
        u, v = block.answer_px[:, 0], block.answer_px[:, 1]
        width, height = self.context.queries.size
        inside = (u >= 0) & (u <= width) & (v >= 0) & (v <= height)  # a missing one is not inside
        answered = self.table.columns["answered"][pairs]
        put("outside_image", pairs, answered - sum_by_pair(inside, starts))
        if self._errors is not None:
            self._errors[block.rows] = np.where(counted, block.error_px, np.nan)

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the quantiles."""
        if self._errors is None:
            return
        for index, name in groups:
            values = exact_quantiles(groups.rows(index, self._errors), self._levels)
            for level, value in zip(self._levels, values, strict=True):
                summary.set(name, _NAMES.get(level, f"p{level * 100:g}_px"), value)
