"""Where the ball at a rope's first end is, in a mask that covers both.

A ball is thicker than the rope, but so are crossings and knots. So every thick place and every end
of the mask is a candidate, and what the network says is weighed in:

    score = 2.2 log(r / h) - 3.5 p(rope) + 1.5 log(p(first tenth) + 0.02),

with r the depth of the place in the mask and h half of the rope's width. The best candidate is a
ball if r > 1.5 h. The weights are those of a conditional logistic regression on 290 images of ropes
with a ball, of no test split.

A ball of the table's colour is missing from the mask. The rope's first tenth is then often beyond
doubt all the same, and the ball is drawn where it must be: beyond that end.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy import ndimage

from pliant.baselines.tracing.depth_in_mask import depth_in_mask, farthest_pixels, ridge
from pliant.spec.arrays import FloatArray, Mask
from pliant.spec.ball import thick_places

FIRST_SHARE: Final = 0.1
"""Share of the rope's length that `first` of `ball_in` speaks of."""

_THICK: Final = 1.15  # a candidate's depth, in half widths of the rope
_AROUND: Final = 2.0  # where the first tenth of the rope is looked for, in half widths
_LEAST_FIRST: Final = 0.02
_SHALLOWEST: Final = 0.3
_WEIGHT_DEPTH, _WEIGHT_ROPE, _WEIGHT_FIRST = 2.2, -3.5, 1.5
_LEAST_DEPTH: Final = 1.5  # of a ball, in half widths of the rope
_SURE: Final = 0.95  # p(first tenth) at an end; of 60 ropes without a ball none reaches it
_AT_END: Final = 4.0  # how far the end reaches, in half widths
_LEAST_ROPE: Final = 0.02  # weight of a pixel there that the network does not take for rope
_RADIUS: Final = 3.0  # of a ball that the mask lacks, in half widths


def ball_in(objects: Mask, rope: FloatArray, first: FloatArray) -> Mask:
    """Return the ball of a rope, or nothing where the rope seems to have none.

    Args:
        objects: bool (H, W), where the rope or its ball is seen.
        rope: float (H, W), the probability that a pixel shows the rope.
        first: float (H, W), the probability that a pixel of the rope is in its first tenth.

    Returns:
        bool (H, W), a part of `objects`, or a disc beyond an end of it.
    """
    depth_px = depth_in_mask(objects, objects.shape[1])
    middle = ridge(depth_px, 1.0)
    if not middle.any():
        return np.zeros_like(objects)
    half_px = float(np.median(depth_px[middle]))

    def score(place: tuple[int, int]) -> float:
        own_px = float(depth_px[place])
        gap_px = _gap_px(place, objects.shape)
        near = gap_px <= max(own_px, half_px) + 1
        around = gap_px <= max(own_px, half_px) + _AROUND * half_px
        return float(
            _WEIGHT_DEPTH * np.log(max(own_px / half_px, _SHALLOWEST))
            + _WEIGHT_ROPE * rope[near].mean()
            + _WEIGHT_FIRST * np.log(first[around].mean() + _LEAST_FIRST)
        )

    ends = _ends(objects)
    best = max([*thick_places(depth_px, _THICK * half_px), *ends], key=score)
    radius_px = _LEAST_DEPTH * half_px
    cores, _ = ndimage.label(depth_px > radius_px)
    if cores[best] == 0:
        return _beyond_first_end(ends, objects, rope, first, half_px)
    to_core_px = ndimage.distance_transform_edt(cores != cores[best])
    return np.asarray(objects & (to_core_px <= radius_px + 0.5))


def _beyond_first_end(
    ends: Sequence[tuple[int, int]],
    objects: Mask,
    rope: FloatArray,
    first: FloatArray,
    half_px: float,
) -> Mask:
    """Return a disc beyond the end that is the rope's first one, or nothing where that is unsure.

    Args:
        ends: The ends of `objects`, (row, column).
        objects: See `ball_in`.
        rope: Likewise.
        first: Likewise.
        half_px: Half of the rope's width.
    """
    near = [objects & (_gap_px(end, objects.shape) < _AT_END * half_px) for end in ends]
    certainty = [np.average(first[own], weights=rope[own] + _LEAST_ROPE) for own in near]
    surest = int(np.argmax(certainty))
    if certainty[surest] < _SURE:
        return np.zeros_like(objects)
    radius_px = _RADIUS * half_px
    outward = ends[surest] - np.argwhere(near[surest]).mean(axis=0)
    middle = ends[surest] + outward * radius_px / max(float(np.linalg.norm(outward)), 1.0)
    return np.asarray(_gap_px(middle, objects.shape) <= radius_px)


def _gap_px(place: Sequence[float] | FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return the pixels' distance to a place, (row, column)."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    return np.asarray(np.hypot(rows - place[0], columns - place[1]))


def _ends(objects: Mask) -> list[tuple[int, int]]:
    """Return both ends, (row, column), of each connected part."""
    parts, count = ndimage.label(objects, np.ones((3, 3)))
    return [place for part in range(1, count + 1) for place in farthest_pixels(parts == part)]
