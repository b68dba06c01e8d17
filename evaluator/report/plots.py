"""A bar chart as a picture, for documents that are not pages."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pliant.evaluator.report.canvas import (
    COLOURS,
    INK,
    figure_png,
    house_style,
)

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class Bar:
    """One bar of a grouped bar chart.

    Attributes:
        row: Label of its row.
        group: Name of its group, which gives the colour.
        value: Its length.
        interval: Confidence interval, or None.
        reference: A published value to mark in the row, or None.
    """

    row: str
    group: str
    value: float
    interval: tuple[float, float] | None = None
    reference: float | None = None


def bars_png(bars: Sequence[Bar], *, title: str, reference: str) -> bytes:
    """Draw horizontal bars by row and group, with intervals and reference values.

    Args:
        bars: The bars, rows and groups in the order of their first bars.
        title: Heading.
        reference: Name of the reference values.
    """
    rows = list(dict.fromkeys(bar.row for bar in bars))
    groups = list(dict.fromkeys(bar.group for bar in bars))
    height = 0.8 / len(groups)
    with house_style():
        figure = Figure(figsize=(8.0, 1.1 + 0.45 * len(rows)), layout="constrained")
        axes = figure.subplots()
        for k, group in enumerate(groups):
            own = [bar for bar in bars if bar.group == group]
            at = [rows.index(bar.row) + (k - (len(groups) - 1) / 2) * height for bar in own]
            lengths = [bar.value for bar in own]
            colour = COLOURS[k % len(COLOURS)]
            axes.barh(at, lengths, height * 0.92, color=colour, alpha=0.75, label=group)
            for y, bar in zip(at, own, strict=True):
                if bar.interval is not None:
                    axes.plot(bar.interval, [y, y], color=INK, linewidth=1.2)
        marked = [(rows.index(b.row), b.reference) for b in bars if b.reference is not None]
        for k, (y, value) in enumerate(marked):
            axes.plot(
                [value, value], [y - 0.42, y + 0.42], color="#b3123f", linewidth=2,
                label=None if k else reference,
            )  # fmt: skip
        _rows(axes, [textwrap.fill(name, 34) for name in rows])
        axes.set_xlim(left=0)
        figure.suptitle(title, x=0.01, ha="left", fontsize=11)
        if len(groups) + bool(marked) > 1:
            figure.legend(loc="outside lower center", ncols=4)
        return figure_png(figure)


def _rows(axes: Axes, names: Sequence[str]) -> None:
    """Label rows from top to bottom."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(axis="y", visible=False)
