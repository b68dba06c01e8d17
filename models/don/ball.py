"""Where the ball at a rope's first end is, in a mask that covers both.

A ball is thicker than the rope, but so are crossings and knots. So every thick place and every end
of the mask is a candidate, and what the network says is weighed in:

    score = 2.2 log(r / h) - 3.5 p(rope) + 1.5 log(p(first tenth) + 0.02),

with r the depth of the place in the mask and h half of the rope's width. The best candidate is a
ball if r > 1.5 h. The weights are those of a conditional logistic regression on 290 images of ropes
with a ball, of no test split: of their balls 257 are found and 1 other place is taken for one, and
in 60 images of ropes without a ball 1.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy import ndimage

from pliant.baselines.tracing.depth_in_mask import (
    FloatArray,
    Mask,
    depth_in_mask,
    farthest_pixels,
    ridge,
)

FIRST_SHARE: Final = 0.1
"""Share of the rope's length that `first` of `ball_in` speaks of."""

_THICK: Final = 1.15  # a candidate's depth, in half widths of the rope
_AROUND: Final = 2.0  # where the first tenth of the rope is looked for, in half widths
_LEAST_FIRST: Final = 0.02
_SHALLOWEST: Final = 0.3
_WEIGHT_DEPTH, _WEIGHT_ROPE, _WEIGHT_FIRST = 2.2, -3.5, 1.5
_LEAST_DEPTH: Final = 1.5  # of a ball, in half widths of the rope


class _Candidate(NamedTuple):
    """A place that may be the ball's.

    Attributes:
        place: Row and column of its deepest pixel.
        log_depth: Log of its depth in the mask, in half widths of the rope.
        rope: Mean probability that it shows the rope, 0 to 1.
        first: Mean probability around it that a rope there is in its first tenth, 0 to 1.
    """

    place: tuple[int, int]
    log_depth: float
    rope: float
    first: float

    @property
    def score(self) -> float:
        """How likely it is the ball, given that there is one."""
        first = float(np.log(self.first + _LEAST_FIRST))
        return _WEIGHT_DEPTH * self.log_depth + _WEIGHT_ROPE * self.rope + _WEIGHT_FIRST * first


def ball_in(objects: Mask, rope: FloatArray, first: FloatArray) -> Mask:
    """Return the ball of a rope, or nothing where the rope has none.

    Args:
        objects: bool (H, W), where the rope or its ball is seen.
        rope: float (H, W), the probability that a pixel shows the rope.
        first: float (H, W), the probability that a pixel of the rope is in its first tenth.

    Returns:
        bool (H, W), a part of `objects`.
    """
    depth_px = depth_in_mask(objects, objects.shape[1])
    middle = ridge(depth_px, 1.0)
    if not middle.any():
        return np.zeros_like(objects)
    half_px = float(np.median(depth_px[middle]))
    rows, columns = np.indices(objects.shape)

    def candidate(row: int, column: int) -> _Candidate:
        own_px = float(depth_px[row, column])
        gap_px = np.hypot(rows - row, columns - column)
        near = gap_px <= max(own_px, half_px) + 1
        around = gap_px <= max(own_px, half_px) + _AROUND * half_px
        return _Candidate(
            (row, column),
            float(np.log(max(own_px / half_px, _SHALLOWEST))),
            float(rope[near].mean()),
            float(first[around].mean()),
        )

    places = [*_thick_places(depth_px, _THICK * half_px), *_ends(objects)]
    best = max((candidate(*place) for place in places), key=lambda each: each.score)
    radius_px = _LEAST_DEPTH * half_px
    cores, _ = ndimage.label(depth_px > radius_px)
    if cores[best.place] == 0:
        return np.zeros_like(objects)
    to_core_px = ndimage.distance_transform_edt(cores != cores[best.place])
    return np.asarray(objects & (to_core_px <= radius_px + 0.5))


def _thick_places(depth_px: FloatArray, least_px: float) -> list[tuple[int, int]]:
    """Return the deepest pixel, (row, column), of each part that is deeper than something."""
    parts, count = ndimage.label(depth_px > least_px)
    return list(ndimage.maximum_position(depth_px, parts, range(1, count + 1)))


def _ends(objects: Mask) -> list[tuple[int, int]]:
    """Return both ends, (row, column), of each connected part."""
    parts, count = ndimage.label(objects, np.ones((3, 3)))
    return [place for part in range(1, count + 1) for place in farthest_pixels(parts == part)]
