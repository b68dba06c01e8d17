"""Surface images: the matter under positions, the object nearest to them, silhouettes, the truth.

The matter under a source position is looked up in the source frame's surface image and found again
in the target's (`dense_truth`). A surface image has one value per pixel, so that truth is known to
about half a pixel.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import BoolArray, FloatArray, IntArray
from pliant.spec.mask_box import mask_box
from pliant.spec.model import MaterialObject

_CHUNK_CELLS: Final = 1 << 21
_TORN: Final = 8.0
"""Neighbouring pixels further apart than so many median footprints are on different folds."""


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


def neighbour_steps_m(
    surface: ObjectSurface, queried: MaterialObject
) -> Iterator[tuple[tuple[slice, slice], tuple[slice, slice], BoolArray, FloatArray]]:
    """Yield, for the rows and then for the columns of pixels, how far neighbours are apart.

    Yields:
        first, second: What the two pixels of each couple of neighbours are of an image.
        both: bool, of the shape of either, couples of which both pixels show the object.
        step_m: float64, their distance on the material, metres.
    """
    on, fields = surface.on_object, (surface.m0, surface.m1)
    for first, second in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :])):
        both = on[first] & on[second]
        ends = (
            np.stack([m[each][both] for m in fields]).astype(float).T for each in (second, first)
        )
        yield first, second, both, queried.distance_m(*ends)


def typical_step_m(surface: ObjectSurface, queried: MaterialObject) -> float:
    """Return the median material distance of neighbouring pixels of the object, metres; 0 for none.

    Folds and crossings, where neighbours are far apart on the material, do not move the median.
    """
    box = mask_box(surface.on_object)
    inside = ObjectSurface(surface.on_object[box], surface.m0[box], surface.m1[box])
    found = np.concatenate([step_m for *_, step_m in neighbour_steps_m(inside, queried)])
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


@dataclass(frozen=True)
class DenseTruth:
    """Where the matter under some source pixels is in the target frame.

    Attributes:
        on_object: bool (M,), source positions on the queried object.
        visible: bool (M,), whether that matter shows in the target frame.
        uv_b_px: float64 (M, 2), where; NaN where it does not.
    """

    on_object: BoolArray
    visible: BoolArray
    uv_b_px: FloatArray


def dense_truth(
    source: ObjectSurface,
    target: ObjectSurface,
    uv_a_px: FloatArray,
    queried: MaterialObject,
    footprints: float,
) -> DenseTruth:
    """Find the matter under source positions in the target frame.

    Args:
        source: The queried object in the source frame.
        target: The queried object in the target frame.
        uv_a_px: float64 (M, 2), positions in the source frame.
        queried: The queried object.
        footprints: The matter shows where a target pixel is within so many times what one
            pixel spans there.
    """
    count = len(uv_a_px)
    row, column, on_object = nearest_object_pixel(source.on_object, uv_a_px, 0)
    result = DenseTruth(on_object, np.zeros(count, bool), np.full((count, 2), np.nan))
    rows_b, columns_b = np.nonzero(target.on_object)
    asked = np.flatnonzero(on_object)
    if not len(rows_b) or not len(asked):
        return result
    wanted = source.material(row[asked], column[asked])
    there = target.material(rows_b, columns_b)
    footprint = _footprint_m(target, queried)[rows_b, columns_b]
    step = max(1, _CHUNK_CELLS // len(there))
    for first in range(0, len(asked), step):
        part = slice(first, first + step)
        distance = queried.distance_m(wanted[part, None], there[None])
        nearest = distance.argmin(axis=1)
        least = distance[np.arange(len(nearest)), nearest]
        shown = least <= footprints * footprint[nearest]
        chosen = asked[part][shown]
        result.visible[chosen] = True
        result.uv_b_px[chosen, 0] = columns_b[nearest[shown]] + 0.5
        result.uv_b_px[chosen, 1] = rows_b[nearest[shown]] + 0.5
    return result


def _footprint_m(surface: ObjectSurface, queried: MaterialObject) -> FloatArray:
    """Return how much material one pixel spans, float64 (H, W), metres; 0 off the object."""
    typical = typical_step_m(surface, queried)
    result = np.where(surface.on_object, typical, 0.0)
    for first, second, both, step_m in neighbour_steps_m(surface, queried):
        whole = np.zeros(both.shape)
        whole[both] = np.where(step_m <= _TORN * typical, step_m, 0)
        for each in (first, second):
            result[each] = np.maximum(result[each], whole)
    return result
