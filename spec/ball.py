"""The ball at a rope's end, in a mask that does not tell it from the rope.

Given masks usually cover everything that stands out from the table. Matchers need the rope and
the ball apart: a rope is followed from its ball, and its length counts from there.

A ball is thick and round. Every place that is thicker than the rope is opened morphologically, by
a disc whose radius is the mean of half of the rope's width and the place's depth: that removes
the rope. Crossings of two strands are at most sqrt(2) times as thick as the rope, and strands side
by side are thick without being round.
"""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter
from typing import Final

import numpy as np
from scipy import ndimage

from pliant.spec.arrays import FloatArray, Mask
from pliant.spec.mask_box import mask_box

_THICK: Final = 1.5
"""What is this many half widths deep may be a ball: no crossing of two strands is."""

_LEAST_BALL: Final = 1.75
"""Least thickness of a ball over its roundness.

On 132 rendered ropes with a ball (1.99 to 5.2 half widths) all balls reach 1.88; of 102 ropes
without one, the tightest loop reaches 1.59. Ten real balls reach 2.6.
"""

_LARGEST_BALL: Final = 8.0
"""A ball is at most this many half widths thick; the same ropes reach 5.2.

In a ragged mask of a cloth the median half width is that of the fringe, and the cloth is thicker.
"""

_LEAST_ROPE: Final = 8.0
"""A rope is at least this many times as long as wide: a cloth is not a ball with a rope."""

_LARGEST_HOLE: Final = 0.005
"""Holes up to this share of the mask are filled: next to one, a rope seems thinner than it is."""

_EIGHT: Final = np.ones((3, 3), np.bool_)


def without_small_holes(mask: Mask) -> Mask:
    """Return a mask with holes filled that are small for it.

    Args:
        mask: bool (H, W).
    """
    parts, _ = ndimage.label(~mask)
    sizes = np.bincount(parts.ravel())
    small = sizes <= _LARGEST_HOLE * mask.sum()
    small[0] = False  # the mask itself
    return np.asarray(mask | small[parts])


def thick_places(depth_px: FloatArray, least_px: float) -> list[tuple[int, int]]:
    """Return the deepest pixel of each connected part of a mask that is deeper than something.

    Args:
        depth_px: float64 (H, W), distance to the edge of the mask.
        least_px: Pixels of this depth or less are left out.

    Returns:
        (row, column) of one pixel per part, the first of those that are equally deep.
    """
    parts, _ = ndimage.label(depth_px > least_px)
    places = []
    for number, box in enumerate(ndimage.find_objects(parts), 1):
        inside = np.where(parts[box] == number, depth_px[box], 0.0)
        row, column = np.unravel_index(inside.argmax(), inside.shape)
        places.append((int(row) + box[0].start, int(column) + box[1].start))
    return places


def separate_ball(mask: Mask) -> tuple[Mask, Mask | None]:
    """Divide a mask of a rope with a ball at its end.

    Args:
        mask: bool (H, W), the rope and its ball; small holes do not matter.

    Returns:
        The rope without its ball, bool (H, W), and the ball, bool (H, W), which make up `mask`
        together. A mask without a ball, or of something else than a rope, comes back as it is,
        with None.
    """
    filled = without_small_holes(mask)
    box = mask_box(filled)
    own = _rope_in(*(np.pad(each[box], 1) for each in (mask, filled)))
    if own is None:
        return mask, None
    rope = np.zeros_like(mask)
    rope[box] = own[1:-1, 1:-1]
    return rope, mask & ~rope


def _rope_in(mask: Mask, filled: Mask) -> Mask | None:
    """Return the rope without its ball, or None where there is none.

    Args:
        mask: bool (h, w), with no pixel at the border.
        filled: bool (h, w), the same without small holes.
    """
    depth_px: FloatArray = ndimage.distance_transform_edt(filled)
    ridge = (depth_px >= ndimage.maximum_filter(depth_px, 5)) & (depth_px > 1)
    if not ridge.any():
        return None
    half_px = float(np.median(depth_px[ridge]))
    score, part = max(_candidates(depth_px, half_px), key=itemgetter(0), default=(0.0, mask))
    if score < _LEAST_BALL:
        return None
    ball = part & mask
    rope = _without_crumbs(mask & ~ball, ball, half_px)
    if rope.sum() < _LEAST_ROPE * (2 * half_px) ** 2:
        return None
    return rope


def _candidates(depth_px: FloatArray, half_px: float) -> Iterator[tuple[float, Mask]]:
    """Yield the parts that are as thick as a ball of a rope of a half width.

    Each is what an opening leaves of it, bool (H, W), after its score: its depth in half widths,
    over its roundness, which is its area over that of the largest disc inside it.
    """
    for row, column in thick_places(depth_px, _THICK * half_px):
        radius_px = float(depth_px[row, column])
        if radius_px / half_px > _LARGEST_BALL:
            continue
        opened_px = (half_px + radius_px) / 2
        cores, _ = ndimage.label(depth_px > opened_px)
        to_core_px = ndimage.distance_transform_edt(cores != cores[row, column])
        part = (to_core_px <= opened_px) & (depth_px > 0)
        roundness = float(part.sum() / (np.pi * radius_px**2))
        yield radius_px / half_px / roundness, part


def _without_crumbs(rope: Mask, ball: Mask, half_px: float) -> Mask:
    """Return a rope without the specks at the edge of its ball."""
    parts, _ = ndimage.label(rope, _EIGHT)
    crumb = np.bincount(parts.ravel()) < (2 * half_px) ** 2
    crumb[0] = False
    touching = np.unique(parts[ndimage.binary_dilation(ball, _EIGHT)])
    crumb &= np.isin(np.arange(len(crumb)), touching)
    return np.asarray(rope & ~crumb[parts])
