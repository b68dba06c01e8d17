"""Errors on the material: which matter lies under an answer, how far from the right one."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from pliant.evaluator.arrays import BoolArray, FloatArray, IntArray
from pliant.spec.model import MaterialObject


def farthest_material_m(described: MaterialObject) -> float:
    """Return the largest distance that two points of an object can have, metres."""
    spans = [
        coordinate.metres_per_unit * (coordinate.max - coordinate.min)
        if coordinate.period is None
        else coordinate.metres_per_unit * coordinate.period / 2
        for coordinate in described.material
    ]
    return math.hypot(*spans)


def nearest_object_pixel(
    on_object: BoolArray, uv_px: FloatArray, search_px: int
) -> tuple[IntArray, IntArray, BoolArray]:
    """Return the object's pixel under each position, or the nearest in a small window about it.

    A point near a silhouette is seen in a pixel whose centre may miss the object: the pixels
    within `search_px` rows and columns are looked at as well, nearest centre first.

    Args:
        on_object: bool (H, W), pixels of the object.
        uv_px: float64 (N, 2), finite.
        search_px: Half the width of the window; 0 looks at one pixel.

    Returns:
        row, column: int64 (N,), the pixel (0, 0 where there is none).
        found: bool (N,).
    """
    height, width = on_object.shape
    # Clipped before the conversion, which a huge finite number would not survive.
    home_column = np.floor(np.clip(uv_px[:, 0], -1e6, 1e6)).astype(np.int64)
    home_row = np.floor(np.clip(uv_px[:, 1], -1e6, 1e6)).astype(np.int64)
    best = np.full(len(uv_px), np.inf)
    row = np.zeros(len(uv_px), np.int64)
    column = np.zeros(len(uv_px), np.int64)
    inside_home = (home_row >= 0) & (home_row < height) & (home_column >= 0) & (home_column < width)
    for down in range(-search_px, search_px + 1):
        for right in range(-search_px, search_px + 1):
            r, c = home_row + down, home_column + right
            inside = (r >= 0) & (r < height) & (c >= 0) & (c < width) & inside_home
            inside[inside] = on_object[r[inside], c[inside]]
            squared = (c + 0.5 - uv_px[:, 0]) ** 2 + (r + 0.5 - uv_px[:, 1]) ** 2
            if down == 0 and right == 0:
                squared = np.full(len(uv_px), -1.0)  # the pixel itself comes first
            better = inside & (squared < best)
            best[better] = squared[better]
            row[better], column[better] = r[better], c[better]
    return row, column, np.isfinite(best)


def silhouette_distance_px(on_object: BoolArray, uv_px: FloatArray) -> FloatArray:
    """Return how far positions are from the nearest pixel that is not the object's.

    Args:
        on_object: bool (H, W), pixels of the object.
        uv_px: float64 (N, 2).

    Returns:
        float64 (N,), pixels to the centre of the nearest pixel outside that touches the
        object's mask (the border of the image is outside); inf where the object fills nothing.
    """
    framed = np.pad(on_object, 1)
    touching = np.zeros_like(framed)
    touching[1:] |= framed[:-1]
    touching[:-1] |= framed[1:]
    touching[:, 1:] |= framed[:, :-1]
    touching[:, :-1] |= framed[:, 1:]
    touching &= ~framed
    rows, columns = np.nonzero(touching)
    if not len(rows):
        return np.full(len(uv_px), np.inf)
    centres = np.stack([columns - 0.5, rows - 0.5], axis=1)  # the frame shifts by one pixel
    return np.sqrt(_nearest_squared(uv_px, centres))


def _nearest_squared(points: FloatArray, others: FloatArray) -> FloatArray:
    result = np.empty(len(points))
    step = max(1, (1 << 20) // len(others))
    for first in range(0, len(points), step):
        du = points[first : first + step, None, 0] - others[:, 0]
        dv = points[first : first + step, None, 1] - others[:, 1]
        result[first : first + step] = (du * du + dv * dv).min(axis=1)
    return result


def surface_material(
    m0: npt.NDArray[np.float32], m1: npt.NDArray[np.float32], row: IntArray, column: IntArray
) -> FloatArray:
    """Return the material coordinates at pixels of a surface image, float64 (N, 2)."""
    return np.stack([m0[row, column], m1[row, column]], axis=1).astype(np.float64)
