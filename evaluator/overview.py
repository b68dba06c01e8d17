"""One page over several methods' reports: the paper's table, pictures and histograms.

The table is the one of *Learning Correspondence for Deformable Objects* (section V): a row a
tier, a column a method, the root of the mean squared pixel error in each cell.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any

import jinja2

CONTROLS = ("identity", "random", "centroid", "oracle")


@dataclass(frozen=True)
class Column:
    """One method in the table.

    Attributes:
        name: Its heading.
        note: What exactly ran (implementation and version), in a few words.
        scores: Its `scores.json`.
        href: Where its own report lies, relative to the page.
        control: True for identity, random, centroid and oracle, which are set apart.
    """

    name: str
    note: str
    scores: Mapping[str, Any]
    href: str = ""
    control: bool = False


@dataclass(frozen=True)
class TierSection:
    """What the page shows of one tier.

    Attributes:
        name: Tier name.
        facts: A line about it (sequences, frames, pairs, queries).
        frames_png: PNG bytes of its contact sheet.
        histogram_svg: SVG text of the methods' error histograms.
        matches_png: method -> PNG bytes of its ten best matches.
    """

    name: str
    facts: str
    frames_png: bytes
    histogram_svg: str
    matches_png: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Cell:
    """One figure of the table, formatted."""

    value: str
    best: bool


def table_rows(
    columns: Sequence[Column], tiers: Sequence[str], metric: str
) -> list[tuple[str, list[Cell]]]:
    """Return the table's rows: (tier, a cell a column).

    The best figure of a row is the lowest among the methods; controls do not compete.

    Args:
        columns: The methods.
        tiers: Row names, in order.
        metric: Key under `scores["tiers"][tier]`.
    """
    rows = []
    for tier in tiers:
        values = [column.scores["tiers"].get(tier, {}).get(metric) for column in columns]
        competing = [
            value
            for value, column in zip(values, columns, strict=True)
            if value is not None and not column.control
        ]
        best = min(competing, default=None)
        cells = [
            Cell(
                "not scored" if value is None else format_px(value),
                value is not None and not column.control and value == best,
            )
            for value, column in zip(values, columns, strict=True)
        ]
        rows.append((tier, cells))
    return rows


def format_px(value: float) -> str:
    """Return pixels with three significant places, and a bare 0 for exactly 0."""
    if value == 0:
        return "0"
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def render_overview(
    *,
    title: str,
    intro: str,
    columns: Sequence[Column],
    tiers: Sequence[TierSection],
    metrics: Mapping[str, str],
    facts: Mapping[str, str],
) -> str:
    """Return the page: one self-contained HTML text.

    Args:
        title: The page's heading.
        intro: A sentence under it.
        columns: The methods, in the table's order.
        tiers: The tiers, in the table's order.
        metrics: metric key -> caption; a table each, the first one large.
        facts: Provenance: label -> value.
    """
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters["data_uri"] = _data_uri
    source = (resources.files("pliant.evaluator") / "templates" / "overview.html").read_text()
    tables = [
        {"caption": caption, "rows": table_rows(columns, [tier.name for tier in tiers], metric)}
        for metric, caption in metrics.items()
    ]
    return environment.from_string(source).render(
        title=title, intro=intro, columns=columns, tiers=tiers, tables=tables, facts=facts
    )


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode()
