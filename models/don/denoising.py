"""Pictures without their noise, for finding objects in them.

GrabCut compares single pixels, and noise makes the table as colourful as an object.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

_LIMIT: Final = 3.0  # grey levels; cameras in good light have 1 to 2
_BLUR_PX: Final = 1.0
_CURVATURE: Final = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]]) / 6
_TO_DEVIATION: Final = 1.4826  # a normal distribution's standard deviation / median distance


def noise_of(rgb: npt.NDArray[np.uint8]) -> float:
    """Return the standard deviation of a picture's noise, grey levels of 255.

    The filter of Immerkaer (1996) ignores edges and gradients. The median in place of his mean
    ignores texture that covers less than half of the picture.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
    """
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    return _TO_DEVIATION * float(np.median(np.abs(cv2.filter2D(grey, cv2.CV_32F, _CURVATURE))))


def denoised(rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return a picture smoothed by a median and a Gaussian, or as it is where it has no noise.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
    """
    if noise_of(rgb) < _LIMIT:
        return rgb
    smooth = cv2.GaussianBlur(cv2.medianBlur(rgb, 3), (0, 0), _BLUR_PX)
    return np.asarray(smooth, dtype=np.uint8)
