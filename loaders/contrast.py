"""A grey in which the colours of an object differ.

Colours of the same luminance are one grey: a stripe of such a colour is lost, and with it what
tells a towel's sides apart. So the weights of red, green and blue are chosen for each picture: at
least 0, in steps of a tenth, their sum 1, as in Lu, Xu and Jia, Contrast Preserving Decolorization
(2012). Best are those with the largest

    sum over pairs (i, j) of min(|g_i - g_j|, 50),

of pixels i and j of the object, drawn at random, whose chromaticities (r - m) / m, with m the mean
of r, g and b, differ. The limit keeps one large difference (a hem) from hiding the others; pairs of
one colour, which differ by shading alone, do not count.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from pliant.spec.arrays import Mask

LUMA: Final = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Weights of red, green and blue in luminance (ITU-R BT.601)."""

_WEIGHTS: Final = np.array(
    [(r, g, 10 - r - g) for r in range(11) for g in range(11 - r)], dtype=np.float32
) / np.float32(10)
# Set once; validation towels, not each value, say that they are good enough.
_PAIRS: Final = 2000
_LEAST_PAIRS: Final = 20
_ENOUGH: Final = 50.0  # of 255
_RIM_SHARE: Final = 1 / 200  # of the width: a mask's rim may show the table
_OTHER_COLOUR: Final = 0.15
_DARK: Final = 10.0  # added to m: the chromaticity of dark pixels is noise


def contrast_weights(rgb: npt.NDArray[np.uint8], mask: Mask | None) -> npt.NDArray[np.float32]:
    """Return the weights of red, green and blue that tell the colours of an object apart.

    Args:
        rgb: uint8 (h, w, 3).
        mask: bool (h, w), the object; None takes the whole picture.

    Returns:
        float32 (3,); those of luminance where there is one colour.
    """
    shown = np.ones(rgb.shape[:2], np.bool_)
    if mask is not None:
        rim = max(1, round(_RIM_SHARE * rgb.shape[1]))
        inner = ndimage.binary_erosion(mask, iterations=rim)
        shown = inner if inner.any() else mask
    colours = rgb[shown].astype(np.float32)
    if len(colours) == 0:
        return LUMA
    one, other = colours[np.random.default_rng(0).integers(len(colours), size=(2, _PAIRS))]
    differ = np.abs(_chromaticity(one) - _chromaticity(other)).sum(axis=1) > _OTHER_COLOUR
    if differ.sum() < _LEAST_PAIRS:
        return LUMA
    gaps = np.abs((one - other)[differ] @ _WEIGHTS.T)  # (pairs, weights)
    best: npt.NDArray[np.float32] = _WEIGHTS[np.minimum(gaps, _ENOUGH).sum(axis=0).argmax()]
    return best


def _chromaticity(colours: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    mean = colours.mean(axis=1, keepdims=True)
    return (colours - mean) / (mean + np.float32(_DARK))
