"""Pictures that matplotlib draws, in one style, as PNG bytes.

No global state of matplotlib is changed, and equal input gives equal output.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Final

import matplotlib as mpl
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

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
