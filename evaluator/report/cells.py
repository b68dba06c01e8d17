"""Headings, cells and bars of score tables, alike in reports, leaderboards, cards, commands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pliant.evaluator.metrics.base import OVERALL, listed_figures
from pliant.evaluator.metrics.causes import CAUSES
from pliant.evaluator.protocols.protocol import figures_of
from pliant.evaluator.scores import SIGNIFICANT_DIGITS, Scores
from pliant.evaluator.statistics.ratios import Figure

_ARROWS: Final = {"lower": "\u00a0↓", "higher": "\u00a0↑"}


@dataclass(frozen=True)
class Heading:
    """A metric as the heading of a column.

    Attributes:
        label: Its name for people.
        about: What it is.
        stored_unit: The unit of the values in scores.json, or empty.
        better: `lower`, `higher` or `neither`.
        rounded: Whether its values are `public_scores`, of few digits: no more are written.
    """

    label: str
    about: str
    stored_unit: str
    better: str
    rounded: bool = False

    @property
    def unit(self) -> str:
        """The unit in which `written` shows values, or empty."""
        return "mm" if self.stored_unit == "m" else self.stored_unit

    def written(self, value: float | None) -> str:
        """Return a value for people: px with two decimals, mm with one, else three."""
        if value is None:
            return "–"
        if self.rounded:
            return format_rounded(value * 1000 if self.stored_unit == "m" else value)
        if self.stored_unit == "m":
            return f"{value * 1000:.1f}"
        return f"{value:.2f}" if self.stored_unit == "px" else f"{value:.3f}"

    @property
    def text(self) -> str:
        """The name with its unit."""
        return f"{self.label}, {self.unit}" if self.unit else self.label

    @property
    def in_text(self) -> str:
        """The name with its unit in parentheses."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    @property
    def arrow(self) -> str:
        """The better direction as an arrow, empty where neither is better."""
        return _ARROWS.get(self.better, "")

    def rank_key(self, value: float | None) -> float:
        """Return what methods are sorted by: the best first, those without a value last."""
        if value is None:
            return math.inf
        return -value if self.better == "higher" else value


@dataclass(frozen=True)
class Cell:
    """One figure of a table.

    Attributes:
        value: The value, formatted.
        key: The exact value, to sort by; empty where there is none.
        interval: Its confidence interval, or empty.
        coverage: Share of the pairs that an error of keypoint matches covers, or empty.
    """

    value: str
    key: str
    interval: str
    coverage: str


def format_rounded(value: float) -> str:
    """Return a value with the digits of `public_scores` and no more, such as 131.7 or 13170."""
    return np.format_float_positional(value, SIGNIFICANT_DIGITS, fractional=False, trim="-")


def heading(metric: str, document: Mapping[str, Any]) -> Heading:
    """Return the heading of a metric.

    Args:
        metric: Name of the metric.
        document: The content of scores.json.
    """
    figure = figures_of(document).get(metric, Figure(metric, "neither", "", metric))
    rounded = "rounded" in document
    return Heading(figure.title, figure.about, figure.unit, figure.better, rounded)


def score_cell(document: Mapping[str, Any], group: str, metric: str) -> Cell:
    """Return one figure of scores.json.

    Args:
        document: The content of scores.json.
        group: `overall` or a tier.
        metric: Name of the metric.
    """
    values, intervals = (
        found["overall"] if group == OVERALL else found["tiers"].get(group, {})
        for found in (document, document["intervals"])
    )
    shown = heading(metric, document)
    value, bounds = values.get(metric), intervals.get(metric)
    return Cell(
        value=shown.written(value),
        key="" if value is None else repr(value),
        interval=" – ".join(shown.written(bound) for bound in bounds or ()),
        coverage=_match_coverage(document, values, metric),
    )


def _match_coverage(document: Mapping[str, Any], values: Mapping[str, Any], metric: str) -> str:
    share = values.get("match_coverage")
    if document["submission"]["kind"] != "matches" or share is None:
        return ""
    if metric in {each.name for each in listed_figures("matches", {})}:  # of all pairs or matches
        return ""
    return f"of {share * 100:.1f} % of the pairs"


def cause_bars(
    reports: Sequence[Scores], names: Sequence[str], group: str = OVERALL
) -> dict[str, Any]:
    """Return what the template `cause_table.html.j2` shows: the shares of each method's error.

    Args:
        reports: The reports; those without causes are left out.
        names: The methods' names.
        group: `overall` or a tier.
    """
    rows = []
    for name, report in zip(names, reports, strict=True):
        if "causes" in report.document:
            every = report.document["causes"]
            found = every[OVERALL] if group == OVERALL else every["tiers"][group]
            shares = [found[cause.name]["squared_error_share"] or 0 for cause in CAUSES]
            rows.append((name, [(index, share) for index, share in enumerate(shares) if share]))
    shown = {index for _, shares in rows for index, share in shares if share >= 0.005}
    return {"causes": CAUSES, "cause_rows": rows, "shown_causes": shown}
