"""Every chart of the pages: arrays in, SVG text or PNG bytes out."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pliant.evaluator.report.canvas import (
    COLOURS,
    GREY,
    INK,
    Labels,
    chart_svg,
    figure_png,
    house_style,
)

if TYPE_CHECKING:
    from matplotlib.typing import LegendLocType

Numbers = Sequence[float] | npt.NDArray[Any]

_DASHES: Final = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)), (0, (1, 1)), (0, (8, 2)), (0, (3, 3)))


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


def line_svg(
    series: Mapping[str, tuple[Numbers, Numbers]],
    labels: Labels,
    *,
    legend: LegendLocType = "best",
    markers: bool = False,
    decorate: Callable[[Axes], object] | None = None,
) -> str:
    """Draw lines.

    Args:
        series: Name -> (x, y).
        labels: Heading and axes.
        legend: Place of the legend, which is drawn for two series or more.
        markers: Mark the points.
        decorate: Sets limits and scales, or draws more; the default starts both axes at 0.
    """

    def draw(axes: Axes) -> None:
        for index, (name, (x, y)) in enumerate(series.items()):
            axes.plot(x, y, marker="o" if markers else "", ms=3.5, label=name, **_look(index))
        if decorate is None:
            axes.set_xlim(left=0)
            axes.set_ylim(bottom=0)
        else:
            decorate(axes)
        _legend(axes, len(series), legend)

    return chart_svg(draw, labels)


def cdf_svg(
    series: Mapping[str, tuple[Numbers, Numbers]], *, title: str = "Share of answers within"
) -> str:
    """Draw cumulative distributions of the error.

    Args:
        series: Name -> (error in px ascending, share below it).
        title: Heading.
    """

    def decorate(axes: Axes) -> None:
        axes.set_xscale("log")
        axes.set_ylim(0, 1.02)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")

    labels = Labels(title, "error, px (log scale)", "share of answers")
    return line_svg(series, labels, decorate=decorate)


def reliability_svg(curves: Mapping[str, Mapping[str, Any]], *, radius_px: float) -> str:
    """Draw reliability diagrams: observed frequency over predicted probability.

    Args:
        curves: Name -> `confidence` and `frequency`, lists of equal length.
        radius_px: The radius of the predicted event, px.
    """

    def decorate(axes: Axes) -> None:
        axes.plot([0, 1], [0, 1], color=GREY, linewidth=1, zorder=1)
        axes.set_xlim(0, 1.02)
        axes.set_ylim(0, 1.02)

    x = f"predicted probability of an error up to {radius_px:g} px"
    series = {name: (each["confidence"], each["frequency"]) for name, each in curves.items()}
    labels = Labels("Reliability", x, "observed frequency")
    return line_svg(series, labels, legend="upper left", markers=True, decorate=decorate)


def sparsification_svg(curves: Mapping[str, Mapping[str, Any]]) -> str:
    """Draw sparsification curves, each with the best possible one faint below it.

    Args:
        curves: Name -> `removed`, `rmse_px` and `best_rmse_px`, lists of equal length.
    """

    def decorate(axes: Axes) -> None:
        for index, curve in enumerate(curves.values()):
            colour = COLOURS[index % len(COLOURS)]
            axes.plot(
                curve["removed"], curve["best_rmse_px"], color=colour, alpha=0.35, linewidth=1
            )
        axes.set_xlim(0, 1)
        axes.set_ylim(bottom=0)

    x = "share of the most uncertain answers removed (faint: best possible)"
    series = {name: (each["removed"], each["rmse_px"]) for name, each in curves.items()}
    labels = Labels("Sparsification", x, "RMSE of the rest, px")
    return line_svg(series, labels, legend="lower left", decorate=decorate)


def histogram_svg(series: Mapping[str, Numbers], edges: Numbers, labels: Labels) -> str:
    """Draw histograms of several methods or tiers over each other, as outlines.

    Args:
        series: Name -> share of each bin, (B,).
        edges: Bin edges, (B + 1,).
        labels: Heading and axes.
    """

    def draw(axes: Axes) -> None:
        for index, (name, share) in enumerate(series.items()):
            look = _look(index)
            axes.stairs(
                np.asarray(share, float), np.asarray(edges, float), label=name,
                color=look["color"], linestyle=look["linestyle"], linewidth=1.6,
            )  # fmt: skip
            if len(series) == 1:
                axes.stairs(share, edges, fill=True, color=look["color"], alpha=0.15)
        axes.set_xlim(edges[0], edges[-1])
        axes.set_ylim(bottom=0)
        _legend(axes, len(series), "upper right")

    return chart_svg(draw, labels)


def box_svg(
    boxes: Mapping[str, Mapping[str, float]], *, title: str, xlabel: str = "RMSE of a pair, px"
) -> str:
    """Draw box plots: box from the first to the third quartile, whiskers at 5 and 95 %.

    Args:
        boxes: Name -> `p5`, `p25`, `p50`, `p75`, `p95`.
        title: Heading.
        xlabel: Axis label.
    """

    def draw(axes: Axes) -> None:
        for index, box in enumerate(boxes.values()):
            colour = COLOURS[index % len(COLOURS)]
            axes.plot([box["p5"], box["p95"]], [index, index], color=INK, linewidth=1)
            width = box["p75"] - box["p25"]
            axes.barh(index, width, 0.5, box["p25"], color=colour, alpha=0.35, edgecolor=INK)
            middle = [index - 0.25, index + 0.25]
            axes.plot([box["p50"], box["p50"]], middle, color=INK, linewidth=1.8)
        _rows(axes, list(boxes))
        axes.set_xlim(left=0)

    return chart_svg(draw, Labels(title, xlabel), height_in=1.1 + 0.42 * len(boxes))


def interval_svg(rows: Mapping[str, tuple[float, float, float]], *, title: str, xlabel: str) -> str:
    """Draw differences with their confidence intervals, one per row, and zero as a line.

    Args:
        rows: Name -> (low, value, high).
        title: Heading.
        xlabel: Axis label.
    """

    def draw(axes: Axes) -> None:
        axes.axvline(0, color=GREY, linewidth=1)
        for index, (low, value, high) in enumerate(rows.values()):
            colour = COLOURS[0] if low > 0 or high < 0 else GREY
            axes.plot([low, high], [index, index], color=colour, linewidth=2.4)
            axes.plot([value], [index], "o", color=colour, ms=5)
        _rows(axes, list(rows))

    return chart_svg(draw, Labels(title, xlabel), height_in=1.0 + 0.38 * len(rows))


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


def _look(index: int) -> dict[str, Any]:
    return {
        "color": COLOURS[index % len(COLOURS)],
        "linestyle": _DASHES[index % len(_DASHES)],
    }


def _legend(axes: Axes, series: int, place: LegendLocType) -> None:
    if series > 1:
        axes.legend(loc=place)


def _rows(axes: Axes, names: Sequence[str]) -> None:
    """Label rows from top to bottom."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(axis="y", visible=False)
