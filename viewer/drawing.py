"""The drawing style that all figures share: panels, points, colours, endings of files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.baselines.matcher import Heat
from pliant.spec.arrays import FloatArray, Rgb
from pliant.spec.errors import CallError
from pliant.spec.io.exr import Surface
from pliant.spec.model import Tier

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Window = tuple[float, float, float, float]
"""Left, right, bottom and top of what is shown of an image, pixels."""

PICTURES: Final = (".png", ".jpg", ".jpeg", ".webp")
DRAWINGS: Final = (*PICTURES, ".pdf", ".svg")
_DPI: Final = 100
_TITLE_IN: Final = 0.3
_LOG_RANGE: Final = 10.0  # e^-10 of the largest is as good as nothing
_LOWEST_SHOWN: Final = 0.05  # quantile at the lower end of the colours, of values that are not logs

_CORNERS = np.array(
    [[[0.15, 0.20, 0.75], [0.10, 0.75, 0.85]], [[0.85, 0.15, 0.35], [0.98, 0.85, 0.20]]]
)
# Colours of a cloth's corners: [u][v], mixed in between.


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


def number_colour(number: int, count: int) -> tuple[float, float, float, float]:
    """Return the colour of one of `count` numbered points, RGBA, 0 to 1."""
    from matplotlib import colormaps

    return colormaps["turbo"](0.05 + 0.9 * number / max(1, count - 1))


def name_point(axis: Axes, uv_px: npt.ArrayLike, name: str) -> None:
    """Write a point's name next to it."""
    u, v = np.asarray(uv_px, np.float64)
    axis.annotate(
        name,
        (float(u), float(v)),
        xytext=(5, 4),
        textcoords="offset points",
        fontsize=8,
        color="white",
        bbox={"boxstyle": "round,pad=0.15", "fc": "#000000a0", "lw": 0},
    )


def heat_range(heat: Heat) -> tuple[float, float]:
    """Return the values at both ends of a heat map's colours, of which it has a finite one.

    Logarithms are drawn down to a factor of e^-10 of the largest, other values from a low quantile.
    """
    finite = heat.values[np.isfinite(heat.values)].astype(np.float64)
    low, high = float(np.quantile(finite, _LOWEST_SHOWN)), float(finite.max())
    return (max(low, high - _LOG_RANGE) if heat.label.startswith("log") else low), high


def positions_px(table: pa.Table, u: str = "u_px", v: str = "v_px") -> FloatArray:
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


def material_colours(
    m0: npt.NDArray[Any], m1: npt.NDArray[Any], tier: Tier
) -> npt.NDArray[np.float64]:
    """Return index colours: one colour for one material point, in every frame.

    Args:
        m0: (N,), first material coordinate of the queried object.
        m1: (N,), second material coordinate.
        tier: The tier.

    Returns:
        float64 (N, 3), sRGB 0 to 1. A rope is coloured along its length, a little darker on one
        side of theta; a cloth by its four corners.
    """
    first, second = tier.queried.material
    a = np.clip((m0 - first.min) / (first.max - first.min), 0.0, 1.0)
    if tier.kind == "rope":
        from matplotlib import colormaps

        colours: npt.NDArray[np.float64] = colormaps["turbo"](0.04 + 0.92 * a)[:, :3]
        return colours * (0.84 + 0.16 * np.cos(np.asarray(m1, np.float64)))[:, None]
    b = np.clip((m1 - second.min) / (second.max - second.min), 0.0, 1.0)
    a, b = a[:, None], b[:, None]
    low = (1 - b) * _CORNERS[0, 0] + b * _CORNERS[0, 1]
    high = (1 - b) * _CORNERS[1, 0] + b * _CORNERS[1, 1]
    mixed: npt.NDArray[np.float64] = (1 - a) * low + a * high
    return mixed


def index_image(surface: Surface, tier: Tier) -> Rgb:
    """Return the index colours of a frame; other objects grey, the rest near black."""
    out = np.full((*surface.object_id.shape, 3), 18, np.uint8)
    out[surface.object_id > 0] = 120
    on = surface.object_id == tier.queried_object
    out[on] = np.rint(255 * material_colours(surface.m0[on], surface.m1[on], tier)).astype(np.uint8)
    return out


def depth_image(surface: Surface) -> Rgb:
    """Return the depth of a frame: near is bright; its own range is spread out."""
    from matplotlib import colormaps

    out = np.full((*surface.depth_m.shape, 3), 18, np.uint8)
    on = np.isfinite(surface.depth_m)
    if not on.any():
        return out
    depth = surface.depth_m[on].astype(np.float64)
    low, high = depth.min(), depth.max()
    near = (high - depth) / max(high - low, 1e-9)
    out[on] = np.rint(255 * colormaps["magma"](0.15 + 0.8 * near)[:, :3]).astype(np.uint8)
    return out
