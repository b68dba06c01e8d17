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

from pliant.spec.text import shown

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
        matches_svg: caption -> SVG text of a method's best matches.
    """

    name: str
    facts: str
    frames_png: bytes
    histogram_svg: str
    matches_svg: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Cell:
    """One figure of the table, formatted."""

    value: str
    best: bool


def table_rows(
    columns: Sequence[Column], tiers: Sequence[str], metric: str
) -> list[tuple[str, list[Cell]]]:
    """Return the table's rows: (tier, a cell a column).

    The best figure of a row is the lowest among the methods (the highest, of a PCK); controls
    do not compete.

    Args:
        columns: The methods.
        tiers: Row names, in order.
        metric: Key under `scores["tiers"][tier]`.
    """
    higher_is_better = metric.startswith("pck")
    rows = []
    for tier in tiers:
        values = [column.scores["tiers"].get(tier, {}).get(metric) for column in columns]
        competing = [
            value
            for value, column in zip(values, columns, strict=True)
            if value is not None and not column.control
        ]
        best = (max if higher_is_better else min)(competing, default=None)
        cells = [
            Cell(
                "–" if value is None else f"{value:.3f}" if higher_is_better else format_px(value),
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
    tables: Sequence[tuple[Sequence[Column], str, str]],
    tiers: Sequence[TierSection],
    facts: Mapping[str, str],
) -> str:
    """Return the page: one self-contained HTML text.

    Args:
        title: The page's heading.
        intro: A sentence under it.
        tables: (columns, metric, caption): a table each, in order.
        tiers: The tiers, in the tables' order.
        facts: Provenance: label -> value.
    """
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, finalize=shown
    )
    environment.filters["data_uri"] = _data_uri
    source = (
        resources.files("pliant.evaluator.report") / "templates" / "overview.html"
    ).read_text()
    names = [tier.name for tier in tiers]
    drawn = [
        {"caption": caption, "columns": columns, "rows": table_rows(columns, names, metric)}
        for columns, metric, caption in tables
    ]
    notes = {column.name: column.note for columns, _, _ in tables for column in columns}
    return environment.from_string(source).render(
        title=title, intro=intro, tables=drawn, notes=notes, tiers=tiers, facts=facts
    )


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode()
