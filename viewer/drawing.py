"""The drawing style that all figures share: panels of one size, points, endings of files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.errors import CallError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Rgb = npt.NDArray[np.uint8]
Float64 = npt.NDArray[np.float64]
Window = tuple[float, float, float, float]
"""Left, right, bottom and top of what is shown of an image, pixels."""

PICTURES: Final = (".png", ".jpg", ".jpeg", ".webp")
DRAWINGS: Final = (*PICTURES, ".pdf", ".svg")
_DPI: Final = 100
_TITLE_IN: Final = 0.3


def strip(
    count: int, size: tuple[int, int], *, columns: int, width_in: float
) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels for images of one size, row by row.

    Args:
        count: Number of panels.
        size: (width, height) of the images, px.
        columns: Panels per row at most.
        width_in: Width of a panel, inches.
    """
    from matplotlib.figure import Figure

    columns = min(count, columns)
    rows = -(-count // columns)
    image_in = width_in * size[1] / size[0]
    tall = rows * (image_in + _TITLE_IN)
    figure = Figure(figsize=(width_in * columns, tall), dpi=_DPI, facecolor="white")
    figure.subplots_adjust(
        0.004, 0.005, 0.996, 1 - _TITLE_IN / tall, wspace=0.02, hspace=_TITLE_IN / image_in
    )
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for unused in axes[count:]:
        unused.set_axis_off()
    return figure, axes[:count]


def show(axis: Axes, image: Rgb, title: str, window: Window | None = None) -> None:
    """Show an image in a panel; the first pixel reaches from 0 to 1, as in the specification.

    Args:
        axis: The panel.
        image: uint8 (H, W, 3).
        title: Text above it.
        window: What is shown of it; None for all.
    """
    height, width = image.shape[:2]
    axis.imshow(image, extent=(0, width, height, 0))
    left, right, bottom, top = window or (0, width, height, 0)
    axis.set(xlim=(left, right), ylim=(bottom, top), xticks=[], yticks=[])
    axis.set_title(title, fontsize=10)


def draw_point(axis: Axes, uv_px: npt.NDArray[Any], colour: Any, *, seen: bool) -> None:
    """Draw a point of an object: a dot, hollow where the point is not visible."""
    face, edge = (colour, "white") if seen else ("none", colour)
    axis.plot(*uv_px, "o", ms=6, mfc=face, mec=edge, mew=1.0)


def positions_px(table: pa.Table, u: str = "u_px", v: str = "v_px") -> Float64:
    """Return two columns of a table as positions, float64 (N, 2)."""
    return np.stack([table[u].to_numpy(), table[v].to_numpy()], axis=1).astype(np.float64)


def evenly(count: int, of: int) -> list[int]:
    """Return at most `count` different indices, spread evenly over 0 to `of` - 1."""
    picks = np.linspace(0, of - 1, min(count, of)).round().astype(int)
    return [int(pick) for pick in np.unique(picks)]


def check_ending(path: Path, allowed: Sequence[str]) -> None:
    """Refuse a file whose ending is none of the allowed ones.

    Raises:
        CallError: It is another one.
    """
    if path.suffix.lower() not in allowed:
        raise CallError(
            "the figure cannot be written in this format: its ending is unknown",
            path=path,
            found=path.suffix or "no ending",
            required=", ".join(allowed),
        )
