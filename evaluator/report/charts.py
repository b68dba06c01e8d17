"""Every chart of the pages as a Vega-Lite specification: arrays in, JSON-able documents out.

`templates/charts.js` draws them with the library in `vendor/`; the page's own colours apply.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Numbers = Sequence[float] | npt.NDArray[Any]
Chart = dict[str, Any]
"""A Vega-Lite specification without sizes and colours, which the page adds."""

_GREY: Final = "#7a8790"
_CLEAR: Final = "#3a86b8"
_ROW_PX: Final = 28

_DASHES: Final = [[1, 0], [4, 2], [2, 2], [8, 3], [6, 2, 2, 2]]
"""Line and gap, px. Vega's own [1, 1] is drawn as a line of half the contrast."""


@dataclass(frozen=True)
class Labels:
    """The texts of a chart.

    Attributes:
        title: Heading.
        x: Label of the horizontal axis.
        y: Label of the vertical axis.
    """

    title: str
    x: str
    y: str = ""


def line_chart(
    series: Mapping[str, tuple[Numbers, Numbers]],
    labels: Labels,
    *,
    log_x: bool = False,
    highest: float | None = None,
    from_zero: bool = True,
    steps: bool = False,
    below: Sequence[Chart] = (),
) -> Chart:
    """Draw lines, each in its own colour and dashes, with the values at the pointer.

    Args:
        series: Name -> (x, y), which are equally long.
        labels: Heading and axes.
        log_x: Whether the horizontal axis is logarithmic.
        highest: End of the vertical axis, or None.
        from_zero: Whether the vertical axis begins at 0.
        steps: Whether a value applies up to the next one, as in a histogram.
        below: Layers under the lines.
    """
    rows = [
        {"series": name, "x": float(a), "y": float(b) if np.isfinite(b) else None}
        for name, (x, y) in series.items()
        for a, b in zip(x, y, strict=True)
    ]
    of_series = {"field": "series", "sort": None}
    of_series |= {"title": None} if len(series) > 1 else {"legend": None}
    across = {"type": "log", "nice": False} if log_x else {"zero": False}
    up = {"zero": from_zero} if highest is None else {"domain": [0, highest]}
    alone = any(np.isfinite(y).sum() == 1 for _, y in series.values())  # a line needs two points
    mark = {"type": "line", "point": True if alone else "transparent"}
    told = [_shown("series", ""), _shown("x", labels.x), _shown("y", labels.y)]
    lines = {
        "data": {"values": rows},
        "mark": mark | ({"interpolate": "step-after"} if steps else {}),
        "encoding": {
            "x": _along("x", labels.x, across),
            "y": _along("y", labels.y, up),
            "color": of_series,
            "strokeDash": of_series | {"scale": {"range": _DASHES}},
            "tooltip": told,
        },
    }
    return {"title": labels.title, "layer": [*below, lines]}


def cdf_chart(
    series: Mapping[str, tuple[Numbers, Numbers]], *, title: str = "Share of answers within"
) -> Chart:
    """Draw cumulative distributions of the error.

    Args:
        series: Name -> (error in px ascending, share below it).
        title: Heading.
    """
    labels = Labels(title, "error, px (log scale)", "share of answers")
    return line_chart(series, labels, log_x=True, highest=1)


def histogram_chart(series: Mapping[str, Numbers], edges: Numbers, labels: Labels) -> Chart:
    """Draw histograms of several methods or tiers over each other, as outlines.

    Args:
        series: Name -> share of each bin, (B,).
        edges: Bin edges, (B + 1,).
        labels: Heading and axes.
    """
    outlines = {name: (edges, [*share, share[-1]]) for name, share in series.items()}
    return line_chart(outlines, labels, steps=True)


def reliability_chart(curves: Mapping[str, Mapping[str, Any]], *, radius_px: float) -> Chart:
    """Draw reliability diagrams: observed frequency over predicted probability.

    Args:
        curves: Name -> `confidence` and `frequency`, lists of equal length.
        radius_px: The radius of the predicted event, px.
    """
    x = f"predicted probability of an error up to {radius_px:g} px"
    series = {name: (each["confidence"], each["frequency"]) for name, each in curves.items()}
    ends = {"values": [{"x": 0, "y": 0}, {"x": 1, "y": 1}]}
    places = {"x": _along("x", x, {}), "y": _along("y", "", {})}
    diagonal = {"data": ends, "mark": {"type": "line", "color": _GREY}, "encoding": places}
    labels = Labels("Reliability", x, "observed frequency")
    return line_chart(series, labels, highest=1, below=[diagonal])


def sparsification_chart(curves: Mapping[str, Mapping[str, Any]]) -> Chart:
    """Draw sparsification curves, each with the best possible one of its tier.

    Args:
        curves: Name -> `removed`, `rmse_px` and `best_rmse_px`, lists of equal length.
    """
    series = {}
    for name, each in curves.items():
        series[name] = each["removed"], each["rmse_px"]
        series[f"{name}, best possible"] = each["removed"], each["best_rmse_px"]
    x = "share of the most uncertain answers removed"
    return line_chart(series, Labels("Sparsification", x, "RMSE of the rest, px"))


def box_chart(boxes: Mapping[str, Mapping[str, float]]) -> Chart:
    """Draw box plots of the RMSE of a pair.

    A box goes from the first to the third quartile, its whiskers to 5 and 95 %.

    Args:
        boxes: Name -> `p5`, `p25`, `p50`, `p75`, `p95`.
    """
    x = "RMSE of a pair, px"
    layers = [
        {"mark": {"type": "rule"}, "encoding": {"x": _along("p5", x, {}), "x2": {"field": "p95"}}},
        {
            "mark": {"type": "bar", "size": 14, "opacity": 0.6},
            "encoding": {"x": _along("p25", x, {}), "x2": {"field": "p75"}},
        },
        {"mark": {"type": "tick", "size": 14}, "encoding": {"x": _along("p50", x, {})}},
    ]
    rows = [{"name": name, **box} for name, box in boxes.items()]
    return _row_chart(rows, layers, "RMSE of the image pairs")


def interval_chart(rows: Mapping[str, tuple[float, float, float]], *, title: str, x: str) -> Chart:
    """Draw differences with their confidence intervals, one per row, and zero as a line.

    Args:
        rows: Name -> (low, value, high).
        title: Heading.
        x: Axis label.
    """
    values = [
        {"name": name, "low": low, "value": value, "high": high, "clear": low > 0 or high < 0}
        for name, (low, value, high) in rows.items()
    ]
    colour = {"condition": {"test": "datum.clear", "value": _CLEAR}, "value": _GREY}
    span = {"x": _along("low", x, {}), "x2": {"field": "high"}, "color": colour}
    layers = [
        {"mark": {"type": "rule", "strokeWidth": 3}, "encoding": span},
        {
            "mark": {"type": "point", "filled": True, "size": 60},
            "encoding": {"x": _along("value", x, {}), "color": colour},
        },
        {"mark": {"type": "rule", "color": _GREY}, "encoding": {"x": {"datum": 0}, "y": None}},
    ]
    return _row_chart(values, layers, title)


def _row_chart(rows: Sequence[Chart], layers: Sequence[Chart], title: str) -> Chart:
    """Return a chart with a labelled row for each value, from top to bottom."""
    names = {"field": "name", "title": None, "sort": None}
    told = [_shown(field, field) for field in rows[0] if field != "clear"]
    return {
        "title": title,
        "height": {"step": _ROW_PX},
        "data": {"values": list(rows)},
        "encoding": {"y": names, "tooltip": told},
        "layer": list(layers),
    }


def _along(field: str, title: str, scale: Mapping[str, Any]) -> Chart:
    """Return the encoding of a number by its place."""
    return {"field": field, "type": "quantitative", "title": title or None, "scale": dict(scale)}


def _shown(field: str, title: str) -> Chart:
    """Return a field as a line of what is shown at the pointer."""
    return {"field": field, "title": title or field}
