"""Area under the curve of recall over the error threshold.

Source: Sarlin et al., SuperGlue, 2020, section 5, and the evaluation of glue-factory (Lindenberger
et al., LightGlue, 2023): errors are sorted, recall rises by 1/n at each, the curve is integrated by
the trapezoidal rule from 0 to the threshold and divided by it.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pliant.evaluator.metrics.base import Groups, Metric, Positives, ScoringContext, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.spec.arrays import FloatArray
from pliant.spec.configuration import Settings
from pliant.spec.constraints import NotEmpty


class AucSettings(Settings):
    """Settings of `auc`.

    Attributes:
        thresholds_px: Ends of the curve, px.
    """

    thresholds_px: Annotated[Positives, NotEmpty()]


class Auc(Metric[AucSettings]):
    """AUC over image pairs, each with its mean error, and over single queries.

    Only queries visible in the target frame count, and pairs that have one.
    """

    Settings = AucSettings

    def __init__(self, settings: AucSettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._errors: list[FloatArray] = []
        self._means = np.full(context.queries.pairs, np.nan)

    def update(self, block: Block) -> None:
        """Take in one block."""
        self._errors.append(block.reach_px.take(block.counted_rows))
        number = block.pair_counted
        total = block.sum_by_pair(np.where(block.counted, block.reach_px, 0.0))
        with np.errstate(invalid="ignore"):
            self._means[block.pairs] = total / np.where(number > 0, number, np.nan)

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the areas of each group."""
        errors = np.concatenate([np.empty(0), *self._errors])
        counted = self.table.columns["counted"]
        for index, group in groups:
            means = self._means[groups.masks[index]]
            queries = np.concatenate(groups.parts(index, errors, counted))
            for suffix, known in (("", means[~np.isnan(means)]), ("_queries", queries)):
                for t in self.settings.thresholds_px:
                    summary.set(group, f"auc_{t:g}px{suffix}", area_under_recall(known, t))


def area_under_recall(errors: FloatArray, threshold: float) -> float:
    """Return the area under the recall curve up to a threshold, over the threshold.

    Args:
        errors: float64 (N,), >= 0; inf for a failure.
        threshold: End of the curve, > 0.

    Returns:
        0 to 1; NaN without errors.
    """
    if not len(errors):
        return float("nan")
    within = np.sort(errors[errors < threshold])
    recall = np.arange(len(within) + 1) / len(errors)
    x = np.concatenate([[0.0], within, [threshold]])
    y = np.concatenate([recall, recall[-1:]])
    return float(((y[1:] + y[:-1]) / 2 * np.diff(x)).sum() / threshold)
