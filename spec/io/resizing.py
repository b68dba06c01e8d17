"""Pictures, masks and other values of pixels at another size."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy import sparse

_COVERED: Final = 0.5 - 1e-5
"""Share of a pixel, less rounding."""


def with_longer_side(size: tuple[int, ...], side: int) -> tuple[int, int]:
    """Return the size of a picture whose longer side is changed to a number of pixels.

    Args:
        size: Its two sides, px, in either order; what follows them is ignored.
        side: That number.

    Returns:
        The sides in the order of `size`, at least 1 px each.
    """
    first, second = size[:2]
    longer = max(first, second)
    return max(1, round(first * side / longer)), max(1, round(second * side / longer))


def resize_nearest(values: npt.NDArray[Any], size: tuple[int, int]) -> npt.NDArray[Any]:
    """Return values at another size: those under each new pixel's centre.

    Masks, ids and depths are never averaged: a mean of two surfaces is on neither.

    Args:
        values: (H, W, ...), of any dtype.
        size: (w, h).

    Returns:
        (h, w, ...), the same dtype.
    """
    height, width = values.shape[:2]
    if (width, height) == size:
        return values
    columns = ((np.arange(size[0]) + 0.5) * width / size[0]).astype(np.intp)
    rows = ((np.arange(size[1]) + 0.5) * height / size[1]).astype(np.intp)
    return values[np.ix_(rows, columns)]


def resize_rgb(rgb: npt.NDArray[np.uint8], size: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Return an image at another size, each pixel the mean of the area it covers.

    A position (u, v) of the old image is at (u w / W, v h / H) of the new one.

    Args:
        rgb: uint8 (H, W, 3).
        size: (w, h).
    """
    height, width = rgb.shape[:2]
    if height % size[1] or width % size[0]:
        return np.rint(_area_means(rgb, size)).astype(np.uint8)
    if (width, height) == size:
        return rgb
    return np.asarray(Image.fromarray(rgb).resize(size, Image.Resampling.BOX))


def _area_means(values: npt.NDArray[Any], size: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Return the mean of the area that each new pixel covers, float32 (h, w, ...).

    Pillow's BOX takes whole pixels only: at ratios such as 1.5 or 2.5 it moves the picture by
    a quarter of a pixel.
    """
    for count in (size[1], size[0]):
        length, *others = values.shape
        edges = np.arange(count + 1) * length / count
        edges = np.union1d(np.arange(length + 1), edges)  # of the parts that pixels share
        middle, part = (edges[1:] + edges[:-1]) / 2, np.diff(edges) * count / length
        at = (middle * count / length).astype(np.int32), middle.astype(np.int32)
        shares = sparse.csr_array((part.astype(np.float32), at), shape=(count, length))
        flat = values.reshape(length, -1).astype(np.float32, copy=False)
        values = (shares @ flat).reshape(count, *others).swapaxes(0, 1)
    return values


def resize_mask(
    mask: npt.NDArray[np.bool_], size: tuple[int, int], *, keep_thin: bool = False
) -> npt.NDArray[np.bool_]:
    """Return a mask at another size: True where half the pixel or more was True.

    Args:
        mask: bool (H, W).
        size: (w, h).
        keep_thin: Where nothing covers half a pixel, take every pixel that is touched.
    """
    height, width = mask.shape
    if (width, height) == size:
        return mask
    small = _area_means(mask, size) >= _COVERED
    if keep_thin and not small.any() and mask.any():
        small = np.zeros_like(small)
        rows, columns = np.nonzero(mask)
        small[rows * size[1] // height, columns * size[0] // width] = True
    return small
