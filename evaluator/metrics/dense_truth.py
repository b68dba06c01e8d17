"""Where matter shows in a target frame, from the surface images of both frames.

The matter under a source position is looked up in the source frame's surface image and found
again in the target's. A surface image has one value per pixel, so the truth is known to about
half a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pliant.evaluator.metrics.surface_images import (
    ObjectSurface,
    nearest_object_pixel,
    pixel_steps_m,
    typical_step_m,
)
from pliant.spec.arrays import BoolArray, FloatArray
from pliant.spec.model import MaterialObject

_CHUNK_CELLS: Final = 1 << 21
_TORN: Final = 8.0
"""Neighbouring pixels further apart than so many median footprints are on different folds."""


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
    across, down = pixel_steps_m(surface, queried)
    typical = typical_step_m(surface, queried)
    result = np.where(surface.on_object, typical, 0.0)
    for span, first, second in (
        (across, np.s_[:, 1:], np.s_[:, :-1]),
        (down, np.s_[1:], np.s_[:-1]),
    ):
        whole = np.where(span <= _TORN * typical, span, 0)
        result[first] = np.maximum(result[first], whole)
        result[second] = np.maximum(result[second], whole)
    return result
