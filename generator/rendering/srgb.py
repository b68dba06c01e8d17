"""Linear light to the 8 bits of the files."""

from __future__ import annotations

from typing import Final

import numpy as np

from pliant.generator.compiled import compiled
from pliant.spec.arrays import BoolArray, ImageArray, RealArray, Rgb

_STEPS: Final = 4096


def _table() -> ImageArray:
    x = (np.arange(_STEPS) + 0.5) / _STEPS
    curve = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.round(255.0 * curve).astype(np.uint8)


_CURVE: Final = _table()


@compiled
def encode_channel(value: float) -> int:
    """Return the sRGB byte of a linear value; below 0 and above 1 are clipped."""
    k = int(value * _STEPS)
    return _CURVE[min(max(k, 0), _STEPS - 1)]


def encode_srgb(linear: RealArray) -> Rgb:
    """Encode an image.

    Args:
        linear: float (H, W, 3), linear light, 1 is white.

    Returns:
        uint8 (H, W, 3), sRGB.
    """
    steps = np.clip(linear * _STEPS, 0, _STEPS - 1).astype(np.int16)
    return _CURVE[steps]


@compiled
def encode_where(mask: BoolArray, linear: RealArray, out: Rgb) -> None:
    """Encode the pixels of a mask as `encode_srgb` does.

    Args:
        mask: bool (H, W).
        linear: float (H, W, 3), linear light, 1 is white.
        out: uint8 (H, W, 3), sRGB; written where the mask is true.
    """
    for j in range(mask.shape[0]):
        for i in range(mask.shape[1]):
            if mask[j, i]:
                for k in range(3):
                    out[j, i, k] = encode_channel(linear[j, i, k])
