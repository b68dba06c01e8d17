"""Errors on the material, where the dataset has surface images."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pliant.evaluator.metrics.base import Groups, Metric, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds


class GeodesicSettings(Settings):
    """Settings of `geodesic`.

    Attributes:
        search_px: Number of rows and columns around an answer's pixel that are searched for the
            object.
    """

    search_px: Annotated[int, Bounds(0, 4)]


class Geodesic(Metric[GeodesicSettings]):
    """Distance on the material, and the rate of answers off the object."""

    Settings = GeodesicSettings
    truth_columns = ("point",)

    def update(self, block: Block) -> None:
        """Take in one block."""
        facts = self.context.surfaces.facts(block, self.context.queries)
        if not facts.known.any():
            return
        points = facts.on_object | (facts.known & block.lost)
        metres = np.where(points, facts.geodesic_m, 0.0)
        self.add_sums(
            block,
            geodesic_asked=facts.known,
            geodesic_points=points,
            off_object=facts.known & ~facts.on_object,
            sum_geodesic_m=metres,
            sum_squared_geodesic_m2=metres**2,
        )

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Say how many pairs had no surface image."""
        counted = self.table.columns["counted"] > 0
        without = int((counted & (self.table.columns["geodesic_asked"] == 0)).sum())
        if without:
            summary.notes["geodesic"] = (
                f"{without:,} of {int(counted.sum()):,} pairs have no surface image or no point "
                "table in this dataset and are left out"
            )
