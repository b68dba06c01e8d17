"""Heat maps as small pictures that a browser lays over the target."""

from __future__ import annotations

import io
from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.baselines.matcher import Heat

_WIDEST_PX: Final = 320
_LOG_RANGE: Final = 10.0  # e^-10 of the largest is as good as nothing
_LOWEST_SHOWN: Final = 0.05  # quantile at the lower end of the colours, of values that are not logs


def heat_png(heat: Heat) -> bytes:
    """Return a heat map as a palette PNG: no belief is transparent, the peak is opaque.

    Args:
        heat: The heat map, of the size of the target.

    Returns:
        A PNG of at most 320 pixels in width.
    """
    step = -(-heat.values.shape[1] // _WIDEST_PX)
    values = heat.values[step // 2 :: step, step // 2 :: step]
    level = np.zeros(values.shape, np.uint8)  # 0 where the method does not look
    known = np.isfinite(values)
    if known.any():
        finite = values[known].astype(np.float64)
        low, high = float(np.quantile(finite, _LOWEST_SHOWN)), float(finite.max())
        if heat.label.startswith("log"):
            low = max(low, high - _LOG_RANGE)
        share = (finite - low) / max(high - low, 1e-12)
        level[known] = np.rint(1 + 254 * share.clip(0, 1))
    colours, alpha = _palette()
    picture = Image.fromarray(level, "P")
    picture.putpalette(colours)
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", transparency=alpha, compress_level=1)
    return buffer.getvalue()


@cache
def _palette() -> tuple[bytes, bytes]:
    """Return 256 colours of the map `inferno`, and their opacity."""
    from matplotlib import colormaps

    share = np.linspace(0, 1, 255)
    rgb: npt.NDArray[np.uint8] = np.zeros((256, 3), np.uint8)
    rgb[1:] = np.rint(255 * colormaps["inferno"](0.15 + 0.85 * share)[:, :3])
    alpha = np.zeros(256, np.uint8)
    alpha[1:] = np.rint(70 + 165 * share)
    return rgb.tobytes(), alpha.tobytes()
