"""One surface image: the matter under positions, the nearest pixel of the object, silhouettes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import BoolArray, FloatArray, IntArray
from pliant.spec.mask_box import mask_box
from pliant.spec.model import MaterialObject


@dataclass(frozen=True)
class ObjectSurface:
    """The queried object in one frame.

    Attributes:
        on_object: bool (H, W).
        m0, m1: float32 (H, W), material coordinates where `on_object`.
    """

    on_object: BoolArray
    m0: npt.NDArray[np.float32]
    m1: npt.NDArray[np.float32]

    def material(self, row: IntArray, column: IntArray) -> FloatArray:
        """Return the material coordinates at pixels, float64 (N, 2)."""
        return np.stack([self.m0[row, column], self.m1[row, column]], axis=1).astype(np.float64)


def pixel_steps_m(surface: ObjectSurface, queried: MaterialObject) -> tuple[FloatArray, FloatArray]:
    """Return the material distance of neighbouring pixels of the object, 0 where one is off it.

    Returns:
        across: float64 (H, W - 1), metres, from each pixel to the next one in its row.
        down: float64 (H - 1, W), metres, to the next one in its column.
    """
    field = np.stack([surface.m0, surface.m1], axis=-1).astype(np.float64)
    on = surface.on_object
    across = np.where(on[:, 1:] & on[:, :-1], queried.distance_m(field[:, 1:], field[:, :-1]), 0)
    down = np.where(on[1:] & on[:-1], queried.distance_m(field[1:], field[:-1]), 0)
    return across, down


def typical_step_m(surface: ObjectSurface, queried: MaterialObject) -> float:
    """Return the median material distance of neighbouring pixels of the object, metres; 0 for none.

    Folds and crossings, where neighbours are far apart on the material, do not move the median.
    """
    box = mask_box(surface.on_object)
    on, m0, m1 = surface.on_object[box], surface.m0[box], surface.m1[box]
    steps = []
    for one, next_ in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        both = on[one] & on[next_]
        ends = [
            np.stack([m0[each][both], m1[each][both]]).astype(np.float64).T for each in (next_, one)
        ]
        steps.append(queried.distance_m(*ends))
    found = np.concatenate(steps)
    found = found[found > 0]
    return float(np.median(found)) if len(found) else 0.0


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
    column, row = np.floor(np.clip(uv_px, -1, (width, height))).astype(np.int64).T
    found = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    row[~found] = column[~found] = 0
    inside = np.flatnonzero(found)
    found[inside] = on_object[row[inside], column[inside]]
    elsewhere = inside[~found[inside]]
    row[elsewhere], column[elsewhere], found[elsewhere] = _nearest_around(
        on_object, uv_px[elsewhere], row[elsewhere], column[elsewhere], search_px
    )
    return row, column, found


def _nearest_around(
    on_object: BoolArray, uv_px: FloatArray, row: IntArray, column: IntArray, search_px: int
) -> tuple[IntArray, IntArray, BoolArray]:
    """Return the object's pixel nearest to positions in the windows around their pixels."""
    side = 2 * search_px + 1
    framed = np.pad(on_object, search_px)
    windows = np.lib.stride_tricks.sliding_window_view(framed, (side, side))
    position, down, right = np.nonzero(windows[row, column])
    r, c = row[position] + down - search_px, column[position] + right - search_px
    squared = (c + 0.5 - uv_px[position, 0]) ** 2 + (r + 0.5 - uv_px[position, 1]) ** 2
    # Of each position the nearest pixel; of equally near ones the first in reading order.
    order = np.lexsort((squared, position))
    found_at, begin = np.unique(position[order], return_index=True)
    best = order[begin]
    result_row, result_column = np.zeros_like(row), np.zeros_like(column)
    found = np.zeros(len(row), bool)
    result_row[found_at], result_column[found_at] = r[best], c[best]
    found[found_at] = True
    return result_row, result_column, found


def silhouette_distance_px(on_object: BoolArray, uv_px: FloatArray) -> FloatArray:
    """Return how far positions are from the nearest pixel that is not the object's.

    Args:
        on_object: bool (H, W), pixels of the object.
        uv_px: float64 (N, 2).

    Returns:
        float64 (N,), pixels to the centre of the nearest pixel outside that touches the
        object's mask (the border of the image is outside); inf where the object fills nothing.
    """
    # Imported here: only figures of surfaces need it.
    from scipy.ndimage import binary_dilation
    from scipy.spatial import cKDTree

    box = mask_box(on_object)
    framed = np.pad(on_object[box], 1)
    rows, columns = np.nonzero(binary_dilation(framed) & ~framed)
    if not len(rows):
        return np.full(len(uv_px), np.inf)
    # The frame shifts by one pixel.
    centres = np.stack([columns + box[1].start - 0.5, rows + box[0].start - 0.5], axis=1)
    distance: FloatArray = cKDTree(centres).query(uv_px)[0]
    return distance
