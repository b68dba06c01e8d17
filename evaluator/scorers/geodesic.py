"""Errors on the material, where the dataset holds surface images."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from pliant.evaluator.metrics.localisation import sum_by_pair
from pliant.evaluator.scorers.base import Groups, Scorer, Summary
from pliant.evaluator.submission.blocks import Block


class GeodesicScorer(Scorer):
    """Distance on the material, and the rate of answers off the object."""

    truth_columns: ClassVar[tuple[str, ...]] = ("point",)

    def update(self, block: Block) -> None:
        """Take in one block."""
        facts = self.context.surfaces.facts(block, self.context.queries)
        starts = block.starts[:-1]
        points = facts.on_object
        if block.missing is not None:
            points = points | (facts.known & block.missing)
        metres = np.where(points, facts.geodesic_m, 0.0)
        put, pairs = self.table.put, block.pairs
        put("geodesic_asked", pairs, sum_by_pair(facts.known, starts))
        put("geodesic_points", pairs, sum_by_pair(points, starts))
        put("off_object", pairs, sum_by_pair(facts.known & ~facts.on_object, starts))
        put("sum_geodesic_m", pairs, sum_by_pair(metres, starts))
        put("sum_squared_geodesic_m2", pairs, sum_by_pair(metres**2, starts))

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Say how many pairs had no surface image."""
        counted = self.table.columns["counted"] > 0
        without = int((counted & (self.table.columns["geodesic_asked"] == 0)).sum())
        if without:
            summary.notes["geodesic"] = (
                f"{without:,} of {int(counted.sum()):,} pairs have no surface image or no point "
                "table in this dataset and are left out"
            )
