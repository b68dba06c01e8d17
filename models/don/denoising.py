"""Pictures without their noise, for finding objects in them.

GrabCut compares single pixels, and noise makes the table as colourful as an object.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from pliant.baselines.conditions import noise_of

_LIMIT: Final = 3.0  # grey levels; cameras in good light have 1 to 2
_BLUR_PX: Final = 1.0


def denoised(rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return a picture smoothed by a median and a Gaussian, or as it is where it has no noise.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
    """
    if noise_of(rgb) < _LIMIT:
        return rgb
    smooth = cv2.GaussianBlur(cv2.medianBlur(rgb, 3), (0, 0), _BLUR_PX)
    return np.asarray(smooth, dtype=np.uint8)
