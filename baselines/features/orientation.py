"""Orientation of the patch around given pixels, as SIFT and ORB define it."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from pliant.baselines.pixels import HALF_PIXEL
from pliant.spec.arrays import Float32Array, FloatArray, ImageArray

BINS: Final = 36


def dominant_gradient_deg(
    cv2: Any, image: ImageArray, uv_px: Float32Array, scale_px: float
) -> FloatArray:
    """Return the direction in which most of the gradient around each position points.

    The histogram of Lowe (IJCV 2004, section 5): 36 bins of gradient magnitude, weighted by
    a Gaussian of 1.5 scales, smoothed, its peak refined by a parabola.

    Args:
        cv2: The OpenCV module.
        image: uint8 (H, W).
        uv_px: float32 (N, 2), inside the image.
        scale_px: Gaussian scale at which gradients are taken.

    Returns:
        float64 (N,), degrees in [0, 360), from +u towards +v.
    """
    column, row = np.floor(uv_px).astype(np.int64).T  # (N,) each
    reach = int(np.ceil(8 * scale_px))  # Gaussian tails and gradients, with room to spare
    top, left = max(0, row.min() - reach), max(0, column.min() - reach)
    window = image[top : row.max() + reach + 1, left : column.max() + reach + 1]
    smooth = cv2.GaussianBlur(window.astype(np.float32), (0, 0), scale_px)
    right = np.zeros_like(smooth)
    down = np.zeros_like(smooth)
    right[:, 1:-1] = smooth[:, 2:] - smooth[:, :-2]
    down[1:-1] = smooth[2:] - smooth[:-2]
    turn = np.arctan2(down, right) * (BINS / (2 * np.pi))
    bins = np.rint(turn).astype(np.int64) % BINS
    magnitude = np.hypot(right, down)

    histogram = np.empty((BINS, len(uv_px)))
    for index in range(BINS):
        part = np.where(bins == index, magnitude, np.float32(0))
        weighted = cv2.GaussianBlur(part, (0, 0), 1.5 * scale_px)
        histogram[index] = weighted[row - top, column - left]
    smoothed = (
        6 * histogram
        + 4 * (np.roll(histogram, 1, axis=0) + np.roll(histogram, -1, axis=0))
        + np.roll(histogram, 2, axis=0)
        + np.roll(histogram, -2, axis=0)
    )
    peak = smoothed.argmax(axis=0)  # (N,)
    here = np.arange(len(uv_px))
    before, after = smoothed[peak - 1, here], smoothed[(peak + 1) % BINS, here]
    curvature = before + after - 2 * smoothed[peak, here]
    flat = curvature == 0
    shift = np.where(flat, 0.0, (before - after) / (2 * np.where(flat, 1.0, curvature)))
    return ((peak + shift) * (360 / BINS)) % 360


def intensity_centroid_deg(image: ImageArray, uv_px: Float32Array, radius_px: int) -> FloatArray:
    """Return the direction from each position to the centroid of the brightness around it.

    The orientation of ORB (Rublee and others, ICCV 2011, section 3.2): atan2(m01, m10) of
    the moments of a disc. They are summed in integers, hence exact.

    Args:
        image: uint8 (H, W).
        uv_px: float32 (N, 2), at least `radius_px` + 1 inside the image.
        radius_px: Radius of the disc.

    Returns:
        float64 (N,), degrees in [0, 360), from +u towards +v.
    """
    pixel = np.rint(uv_px - HALF_PIXEL).astype(np.int64)  # (N, 2) nearest pixel
    column, row = pixel.T
    padded = np.pad(image.astype(np.int64), ((0, 0), (1, 0)))
    mass = padded.cumsum(axis=1)  # mass[:, x] = sum of image[:, :x]
    lever = (padded * (np.arange(padded.shape[1]) - 1)).cumsum(axis=1)
    m10 = np.zeros(len(uv_px), dtype=np.int64)
    m01 = np.zeros(len(uv_px), dtype=np.int64)
    widths = _disc(radius_px)
    for down in range(-radius_px, radius_px + 1):
        half = widths[abs(down)]
        low, high = column - half, column + half + 1
        along = mass[row + down, high] - mass[row + down, low]  # (N,)
        m01 += down * along
        m10 += lever[row + down, high] - lever[row + down, low] - column * along
    return np.degrees(np.arctan2(m01, m10)) % 360


def _disc(radius_px: int) -> list[int]:
    """Return a disc's half width on each row from its centre, the same if axes are swapped."""
    rows = np.arange(radius_px + 1)
    rounded = np.rint(np.sqrt(radius_px**2 - rows**2)).astype(int).tolist()
    return [
        half if 2 * row**2 <= radius_px**2 else max(u for u, v in enumerate(rounded) if v >= row)
        for row, half in enumerate(rounded)
    ]
