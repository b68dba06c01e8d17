"""Pictures that matplotlib draws, in one style, as PNG bytes.

No global state of matplotlib is changed, and equal input gives equal output.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import matplotlib as mpl
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

COLOURS: Final = (
    "#1f5f8b", "#c8553d", "#3d8b5f", "#8a5a9e", "#b8862b", "#5b6770", "#2b9aa8", "#a34a6b",
)  # fmt: skip
"""One per series; the line style differs too, for print and for colour-blind readers."""

INK: Final = "#3a3f44"
GREY: Final = "#9aa1a8"
_STYLE: Final[dict[RcKeyType, Any]] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlecolor": INK,
    "axes.titlelocation": "left",
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.grid": True,
    "grid.color": "#e4e7ea",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.6,
    "figure.dpi": 110,
}


def house_style() -> AbstractContextManager[None]:
    """Return a context in which figures get the style of Pliant's charts."""
    return mpl.rc_context(_STYLE)


def figure_png(figure: Figure) -> bytes:
    """Return a figure as PNG."""
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_png(buffer)
    return buffer.getvalue()


def pictures_png(
    rows: int, columns: int, tile_in: tuple[float, float], draw: Callable[[Figure, Any], None]
) -> bytes:
    """Draw a grid of pictures.

    Args:
        rows: Number of rows.
        columns: Number of columns.
        tile_in: (width, height) of a picture in inches.
        draw: Called with the figure and its axes, (rows, columns), which have no ticks.
    """
    with house_style():
        figure = Figure(figsize=(columns * tile_in[0], rows * tile_in[1]), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
        for each in axes.flat:
            each.set_axis_off()
        draw(figure, axes)
        return figure_png(figure)


def show_picture(axes: Axes, image: npt.NDArray[Any], size: tuple[int, int], **look: Any) -> Any:
    """Show an image in Pliant's pixel coordinates: the first pixel extends from 0 to 1.

    Args:
        axes: Where.
        image: (h, w) or (h, w, 3).
        size: (width, height) of the coordinates in px.
        **look: For `Axes.imshow`.

    Returns:
        What `Axes.imshow` returns.
    """
    width, height = size
    shown = axes.imshow(image, extent=(0, width, height, 0), **look)
    axes.set(xlim=(0, width), ylim=(height, 0))
    return shown


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
