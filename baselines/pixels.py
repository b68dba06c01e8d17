"""Pixels of a view: where their centres are, which are on the object, and how bright they are."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.frame import Frame

HALF_PIXEL: Final = 0.5
"""Pliant puts the centre of array element [0, 0] at (0.5, 0.5), OpenCV and mahotas at (0, 0).

Pliant's coordinate is theirs plus this."""

_LUMA_WEIGHTS: Final = np.array([299, 587, 114], dtype=np.int64)
"""Rec. 601 luma in thousandths."""


def luma(rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return the Rec. 601 luma of an sRGB image, rounded half up in integers.

    Args:
        rgb: uint8 (H, W, 3).

    Returns:
        uint8 (H, W).
    """
    thousandths = rgb.astype(np.int64) @ _LUMA_WEIGHTS  # (H, W)
    return ((thousandths + 500) // 1000).astype(np.uint8)


def searched_mask(view: Frame) -> npt.NDArray[np.bool_]:
    """Return where answers are looked for: the object's mask, or the whole image without one.

    Args:
        view: The target; `view.mask` is bool (H, W) or None.

    Returns:
        bool (H, W).
    """
    if view.mask is not None:
        return view.mask
    return np.ones(view.rgb.shape[:2], dtype=np.bool_)


def pixel_centres(mask: npt.NDArray[np.bool_], stride: int = 1) -> npt.NDArray[np.float32]:
    """Return the centres of a mask's pixels on a grid of every `stride`-th row and column.

    A mask so thin that the grid misses it altogether is taken whole.

    Args:
        mask: bool (H, W).
        stride: Grid step, px, >= 1.

    Returns:
        float32 (G, 2), (u, v) in row-major order.
    """
    offset = stride // 2
    rows, columns = np.nonzero(mask[offset::stride, offset::stride])
    if len(rows) == 0 and stride > 1:
        return pixel_centres(mask)
    centres = np.stack([columns, rows], axis=1) * stride + offset + HALF_PIXEL  # (G, 2)
    return centres.astype(np.float32)


def lies_on(
    uv_px: npt.NDArray[np.floating[Any]], mask: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Return which positions fall into a pixel of the mask.

    Args:
        uv_px: float (N, 2).
        mask: bool (H, W).

    Returns:
        bool (N,); positions outside the image are False.
    """
    height, width = mask.shape
    u, v = uv_px.T
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)  # NaN is nowhere
    hit = np.zeros(len(uv_px), dtype=np.bool_)
    hit[inside] = mask[v[inside].astype(np.int64), u[inside].astype(np.int64)]
    return hit


def central_position(view: Frame) -> npt.NDArray[np.float32]:
    """Return the mean of the mask's pixel centres, or the image's centre without a pixel.

    This is the answer of a method that has nothing to go by.

    Args:
        view: The target.

    Returns:
        float32 (2,), (u, v) in px.
    """
    height, width = view.rgb.shape[:2]
    if view.mask is None or not view.mask.any():
        return np.array([width / 2, height / 2], dtype=np.float32)
    rows, columns = np.nonzero(view.mask)
    centre = np.array([columns.mean(), rows.mean()]) + HALF_PIXEL
    return centre.astype(np.float32)
