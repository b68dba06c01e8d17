"""What a metric is: its name, label, unit and direction; and those that are ratios of sums.

Everything that is an average (RMSE, PCK, AJ …) is the quotient of two columns of the pair table,
summed. Tiers, slices, bootstrap intervals, comparisons and leaderboards all use the same quotient.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pliant.spec.arrays import FloatArray
from pliant.spec.errors import SpecError

Better = Literal["lower", "higher", "neither"]


@dataclass(frozen=True)
class Figure:
    """One metric.

    Attributes:
        name: Its name in scores.json.
        better: Which direction is better; `neither` where a target value is (a coverage).
        unit: Unit for people; empty for a share.
        about: What it is, in one sentence.
        label: Its name in the head of a table; empty for `name` in words.
    """

    name: str
    better: Better
    unit: str
    about: str
    label: str = ""

    @property
    def title(self) -> str:
        """The label, or the name in words without its unit."""
        if self.label:
            return self.label
        text = self.name.removesuffix("_px").removesuffix("_m").replace("_", " ")
        return text[:1].upper() + text[1:]


@dataclass(frozen=True)
class Ratio(Figure):
    """One averaged metric.

    Attributes:
        numerator, denominator: Columns of the pair table.
        root: Whether the root of the quotient is taken.
        over_pairs: Average the quotients of the pairs that have a denominator, each with the
            same weight, instead of dividing the sums (pooling).
    """

    numerator: str = ""
    denominator: str = ""
    root: bool = False
    over_pairs: bool = False

    def mean_over_pairs(self, about: str) -> Ratio:
        """Return the same quotient within each pair, averaged over pairs."""
        return replace(
            self,
            name=f"{self.name}_mean_over_pairs",
            about=about,
            label=f"{self.title}, mean over pairs",
            over_pairs=True,
        )

    def terms(self, columns: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return what is summed above and below, float64 (P,) each.

        Raises:
            SpecError: The table has no such column.
        """
        for name in (self.numerator, self.denominator):
            if name not in columns:
                raise SpecError(
                    "the table of pairs lacks a column of a metric",
                    where=self.name,
                    found=", ".join(sorted(columns)),
                    required=name,
                    fix="Evaluate the submission again with this version of Pliant.",
                )
        above, below = columns[self.numerator], columns[self.denominator]
        if not self.over_pairs:
            return above, below
        defined = below > 0
        value = np.divide(above, below, out=np.zeros(len(above)), where=defined)
        if self.root:
            value = np.sqrt(value)
        return value, defined.astype(np.float64)

    def finish(self, above: FloatArray, below: FloatArray) -> FloatArray:
        """Return the metric from the two sums; NaN where nothing was counted."""
        with np.errstate(invalid="ignore", divide="ignore"):
            value = np.where(below > 0, above / below, np.nan)
            return np.sqrt(value) if self.root and not self.over_pairs else value
