"""The drawing style that all figures share: panels, points, colours, endings of files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from pliant.baselines.matcher import Heat
from pliant.spec.arrays import Rgb
from pliant.spec.errors import CallError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Window = tuple[float, float, float, float]
"""Left, right, bottom and top of what is shown of an image, pixels."""

PICTURES: Final = (".png", ".jpg", ".jpeg", ".webp")
DRAWINGS: Final = (*PICTURES, ".pdf", ".svg")
_LOG_RANGE: Final = 10.0  # e^-10 of the largest is as good as nothing
_LOWEST_SHOWN: Final = 0.05  # quantile at the lower end of the colours, of values that are not logs


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


def dimmed(rgb: Rgb) -> Rgb:
    """Return an image in dark grey, for colours over it, uint8 (H, W, 3)."""
    grey = rgb.mean(axis=2, keepdims=True) * 0.45
    return np.repeat(grey, 3, axis=2).astype(np.uint8)


def heat_range(heat: Heat) -> tuple[float, float]:
    """Return the values at both ends of a heat map's colours, of which it has a finite one.

    Logarithms are drawn down to a factor of e^-10 of the largest, other values from a low quantile.
    """
    finite = heat.values[np.isfinite(heat.values)].astype(np.float64)
    low, high = float(np.quantile(finite, _LOWEST_SHOWN)), float(finite.max())
    return (max(low, high - _LOG_RANGE) if heat.label.startswith("log") else low), high


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
