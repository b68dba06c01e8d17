"""Names of NumPy array types, for annotations; shapes are in the docstrings. The border of one."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
RealArray = npt.NDArray[np.floating[Any]]
"""float32 or float64."""

IntArray = npt.NDArray[np.int64]
Int32Array = npt.NDArray[np.int32]
IndexArray = npt.NDArray[np.integer[Any]]
BoolArray = npt.NDArray[np.bool_]

Mask = npt.NDArray[np.bool_]
"""bool (H, W)."""

Rgb = npt.NDArray[np.uint8]
"""uint8 (H, W, 3), sRGB."""

ImageArray = npt.NDArray[np.uint8]
"""uint8 (H, W) or (H, W, C)."""

StateArray = npt.NDArray[np.uint8]
"""Visibility states as indices into `conventions.VISIBILITY_STATES`."""


def border(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the values of the pixels at the four sides of an image, (N, ...); corners twice."""
    return np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
