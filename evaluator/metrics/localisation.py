"""Errors in pixels: RMSE, mean and quantiles over the queries visible in the target frame."""

from __future__ import annotations

import numpy as np

from pliant.evaluator.metrics.base import (
    Groups,
    Levels,
    Metric,
    NoSettings,
    ScoringContext,
    Summary,
)
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.errors import exact_quantiles
from pliant.evaluator.statistics.ratios import Figure
from pliant.spec.arrays import FloatArray
from pliant.spec.configuration import Settings


class Counts(Metric[NoSettings]):
    """How many rows there are, how many are counted, how many answered: for every protocol."""

    def update(self, block: Block) -> None:
        """Take in one block."""
        self.table.put("counted", block.pairs, block.pair_counted)
        self.add_sums(block, answered=~block.lost)

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the number of queries of each pair."""
        self.table.put("queries", slice(None), np.diff(self.context.queries.starts))


class LocalisationSettings(Settings):
    """Settings of `localisation`.

    Attributes:
        quantiles: Levels of the quantiles of the error.
    """

    quantiles: Levels


class Localisation(Metric[LocalisationSettings]):
    """RMSE, mean and quantiles of the error."""

    Settings = LocalisationSettings

    @classmethod
    def figures(cls, settings: LocalisationSettings) -> list[Figure]:
        """Return the averages and the quantiles, of which the middle one is called the median."""
        median = Figure(_quantile_name(0.5), "lower", "px", "median error", "Median error")
        return [median if each.name == "p50_px" else each for each in super().figures(settings)]

    def __init__(self, settings: LocalisationSettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._errors: list[FloatArray] = []

    def update(self, block: Block) -> None:
        """Take in one block."""
        u, v = block.answer_px[:, 0], block.answer_px[:, 1]
        width, height = self.context.queries.size
        outside = (u < 0) | (u > width) | (v < 0) | (v > height)  # NaN, a missing one, is not
        self.add_sums(block, outside_image=outside)
        self.table.put("sum_squared_px2", block.pairs, block.pair_squared_px2)
        self.table.put("sum_error_px", block.pairs, block.pair_error_px)
        if self.settings.quantiles:
            self._errors.append(block.counted_error_px)

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the quantiles."""
        levels = self.settings.quantiles
        if not levels:
            return
        errors = np.concatenate([np.empty(0), *self._errors])
        counted = self.table.columns["counted"]
        for index, group in groups:
            values = exact_quantiles(groups.parts(index, errors, counted), levels)
            for level, value in zip(levels, values, strict=True):
                summary.set(group, _quantile_name(level), value)


def _quantile_name(level: float) -> str:
    return "median_px" if level == 0.5 else f"p{level * 100:g}_px"
