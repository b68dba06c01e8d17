"""Plots as SVG text, ready to stand inside an HTML page. Arrays in, a string out.

Nothing global is touched: every figure is its own object, and equal input gives equal text.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

Numbers = Sequence[float] | npt.NDArray[Any]

COLOURS: Final = (
    "#1f5f8b", "#c8553d", "#3d8b5f", "#8a5a9e", "#b8862b", "#5b6770", "#2b9aa8", "#a34a6b",
)  # fmt: skip
"""One a series, told apart in print and by the colour-blind by line style as well."""

_DASHES: Final = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)), (0, (1, 1)), (0, (8, 2)), (0, (3, 3)))
_INK: Final = "#3a3f44"
_STYLE: Final[dict[str, Any]] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#9aa1a8",
    "axes.labelcolor": _INK,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlecolor": _INK,
    "axes.titlelocation": "left",
    "xtick.color": _INK,
    "ytick.color": _INK,
    "axes.grid": True,
    "grid.color": "#e4e7ea",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.6,
}


def cdf_svg(
    series: Mapping[str, tuple[Numbers, Numbers]], *, title: str = "Share of answers within"
) -> str:
    """Draw cumulative distributions of the error.

    Args:
        series: Name -> (error in px ascending, share below it).
        title: Heading.
    """

    def draw(axes: Axes) -> None:
        for index, (name, (error, share)) in enumerate(series.items()):
            axes.plot(error, share, label=name, **_look(index))
        axes.set_xscale("log")
        axes.set_ylim(0, 1.02)
        axes.set_xlabel("error, px (log scale)")
        axes.set_ylabel("share of answers")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        _legend(axes, len(series), "best")

    return _render(draw, title)


def time_svg(
    series: Mapping[str, tuple[Numbers, Numbers]], *, title: str = "RMSE since the query"
) -> str:
    """Draw the error over the frames since the query.

    Args:
        series: Name -> (frames ascending, RMSE in px after so many).
        title: Heading.
    """

    def draw(axes: Axes) -> None:
        for index, (name, (frames, rmse)) in enumerate(series.items()):
            axes.plot(frames, rmse, label=name, **_look(index))
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
        axes.set_xlabel("frames since the query")
        axes.set_ylabel("RMSE, px")
        _legend(axes, len(series), "best")

    return _render(draw, title)


def histogram_svg(
    series: Mapping[str, Numbers],
    edges: Numbers,
    *,
    title: str,
    xlabel: str = "error, px",
    ylabel: str = "share of answers",
) -> str:
    """Draw histograms of several methods or tiers over each other, as outlines.

    Args:
        series: Name -> share of each bin, (B,).
        edges: Bin edges, (B + 1,).
        title: Heading.
        xlabel: Axis label.
        ylabel: Axis label.
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
        axes.set_xlabel(xlabel)
        axes.set_ylabel(ylabel)
        _legend(axes, len(series), "upper right")

    return _render(draw, title)


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
            axes.plot([box["p5"], box["p95"]], [index, index], color=_INK, linewidth=1)
            width = box["p75"] - box["p25"]
            axes.barh(index, width, 0.5, box["p25"], color=colour, alpha=0.35, edgecolor=_INK)
            middle = [index - 0.25, index + 0.25]
            axes.plot([box["p50"], box["p50"]], middle, color=_INK, linewidth=1.8)
        axes.set_yticks(range(len(boxes)), list(boxes))
        axes.set_ylim(len(boxes) - 0.5, -0.5)
        axes.grid(axis="y", visible=False)
        axes.set_xlim(left=0)
        axes.set_xlabel(xlabel)

    return _render(draw, title, height_in=1.1 + 0.42 * len(boxes))


def reliability_svg(curves: Mapping[str, Mapping[str, Any]], *, radius_px: float) -> str:
    """Draw reliability diagrams: how often it was so against how often it was said.

    Args:
        curves: Name -> `confidence` and `frequency`, lists of equal length.
        radius_px: The radius the probability speaks of.
    """

    def draw(axes: Axes) -> None:
        axes.plot([0, 1], [0, 1], color="#9aa1a8", linewidth=1)
        for index, (name, curve) in enumerate(curves.items()):
            look = _look(index)
            axes.plot(
                curve["confidence"], curve["frequency"], marker="o", ms=3.5, label=name, **look
            )
        axes.set_xlim(0, 1.02)
        axes.set_ylim(0, 1.02)
        axes.set_xlabel(f"predicted probability of an error up to {radius_px:g} px")
        axes.set_ylabel("how often it was so")
        _legend(axes, len(curves), "upper left")

    return _render(draw, "Reliability")


def sparsification_svg(curves: Mapping[str, Mapping[str, Any]]) -> str:
    """Draw sparsification curves, each with its best possible one in grey below it.

    Args:
        curves: Name -> `removed`, `rmse_px` and `best_rmse_px`, lists of equal length.
    """

    def draw(axes: Axes) -> None:
        for index, (name, curve) in enumerate(curves.items()):
            axes.plot(curve["removed"], curve["rmse_px"], label=name, **_look(index))
            colour = COLOURS[index % len(COLOURS)]
            axes.plot(
                curve["removed"], curve["best_rmse_px"], color=colour, alpha=0.35, linewidth=1
            )
        axes.set_xlim(0, 1)
        axes.set_ylim(bottom=0)
        axes.set_xlabel("share of the most uncertain answers removed (faint: best possible)")
        axes.set_ylabel("RMSE of the rest, px")
        _legend(axes, len(curves), "lower left")

    return _render(draw, "Sparsification")


def interval_svg(rows: Mapping[str, tuple[float, float, float]], *, title: str, xlabel: str) -> str:
    """Draw differences with their confidence intervals, one a row, and zero as a line.

    Args:
        rows: Name -> (low, value, high).
        title: Heading.
        xlabel: Axis label.
    """

    def draw(axes: Axes) -> None:
        axes.axvline(0, color="#9aa1a8", linewidth=1)
        for index, (low, value, high) in enumerate(rows.values()):
            clear = low > 0 or high < 0
            colour = COLOURS[0] if clear else "#9aa1a8"
            axes.plot([low, high], [index, index], color=colour, linewidth=2.4)
            axes.plot([value], [index], "o", color=colour, ms=5)
        axes.set_yticks(range(len(rows)), list(rows))
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel(xlabel)

    return _render(draw, title, height_in=1.0 + 0.38 * len(rows))


def _look(index: int) -> dict[str, Any]:
    return {
        "color": COLOURS[index % len(COLOURS)],
        "linestyle": _DASHES[index % len(_DASHES)],
    }


def _legend(axes: Axes, series: int, place: str) -> None:
    if series > 1:
        axes.legend(loc=place)


def _render(draw: Any, title: str, *, width_in: float = 4.6, height_in: float = 2.9) -> str:
    """Return a figure as an SVG element that scales with its container."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        axes = figure.add_subplot()
        draw(axes)
        axes.set_title(title)
        with mpl.rc_context({"svg.hashsalt": title}):
            buffer = io.StringIO()
            FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(
        r"'DejaVu Sans'[^;\"]*sans-serif",
        "-apple-system, 'Segoe UI', Roboto, Arial, 'DejaVu Sans', sans-serif",
        text,
    )
    # Ids are unique to a figure, so that several can stand in one page.
    prefix = "p" + hashlib.sha256(text.encode()).hexdigest()[:8] + "-"
    text = re.sub(r'\bid="', f'id="{prefix}', text)
    text = text.replace('"#', f'"#{prefix}').replace("url(#", f"url(#{prefix}")
    label = title.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    head, body = text.split(">", 1)
    head = re.sub(r' (width|height)="[^"]*"', "", head)
    text = f"{head}>{body}"
    return text.replace("<svg ", f'<svg class="plot" role="img" aria-label="{label}" ', 1)
