"""A rope's mask that cannot be exact, made again from it and the picture.

A segmenter's masks are ragged, have holes and lose ends, and may contain a second object. The
masks that the network finds in the picture itself (`segmentation.py`) have none of these faults,
but now and then miss a part, or the ball. So a given mask is corrected only where its own shape is
not that of one rope, where it is of uneven width and its contour is not that of the picture, or
where much of it is far from the one rope that the picture shows.
"""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from pliant.baselines.tracing import MaskShape
from pliant.spec.arrays import Mask

_PICTURE_SIDE: Final = 640  # the lengths below are pixels of a picture with this longer side
_LIMIT_PX: Final = 0.95
_UNEVEN_PX: Final = 0.65
_UNEVEN_SHARE: Final = 0.06  # of the half-width, where that is more: a thick rope's strands show
_FOREIGN_SHARE: Final = 0.15
_LITTLE_FOREIGN: Final = 0.05
_FARTHEST_PX: Final = 4.0
_REACH_PX: Final = 16.0
_KEPT_PX: Final = 6.0
_BALL_PX: Final = 3.0
_BALL_RIM_PX: Final = 2.0


def is_surely_unchanged(mask: Mask, objects: Mask, likely: Mask) -> bool:
    """Return whether `repaired` keeps masks, before what is found has been sharpened by colour.

    It holds for 90 to 100 % of exact masks (50 to 70 % where something covers the rope). Of 700
    masks of validation pictures, most of them altered, it held for 322, and `repaired` kept
    all of these.

    Args:
        mask: bool (H, W), the rope, as given; not empty.
        objects: Likewise, the rope and its ball.
        likely: bool (H, W), where the network sees the rope or its ball.
    """
    px = max(mask.shape) / _PICTURE_SIDE
    shown = mask | objects
    return (
        not _uneven(mask, px)
        and (shown & ~_near(likely, _KEPT_PX * px)).sum() <= _LITTLE_FOREIGN * shown.sum()
        and not MaskShape.of(mask, objects).several_ropes
    )


def repaired(
    mask: Mask, objects: Mask | None, found: tuple[Mask, Mask | None]
) -> tuple[Mask, Mask | None] | None:
    """Return corrected masks of a rope, or with its ball, or None for masks that are kept.

    Exact masks and those found in the picture have contours 0.4 to 0.9 px apart on average,
    damaged ones 1.0 to 1.6 px (5th to 95th percentile of training and validation pictures 640
    pixels wide). Half-widths of exact masks deviate by 0.1 to 0.6 px, those of ragged ones by 0.9
    to 2.0 px; 3 of 400 exact masks are uneven and 400 of 400 ragged ones (240 ropes from above, 80
    in an unseen look, 80 oblique).

    Args:
        mask: bool (H, W), the rope, as given; not empty.
        objects: Likewise, the rope and its ball, or None.
        found: The same as found in the picture.

    Returns:
        Two such masks. The ball is as it was given, and where none was, the one in the picture.
    """
    px = max(mask.shape) / _PICTURE_SIDE
    kept: tuple[Mask, Mask | None] | None = None
    if objects is None and found[1] is not None:
        ball = found[1] & ~found[0]
        if (ball & _near(mask, _REACH_PX * px)).any():
            mask, objects = mask & ~ball, mask | ball
            kept = mask, objects
    shown = mask if objects is None else mask | objects
    seen = found[0] if found[1] is None else found[0] | found[1]
    ragged = _uneven(mask, px) and (
        _contour_distance(shown, seen, _FARTHEST_PX * px) >= _LIMIT_PX * px
    )
    known = _near(seen, _KEPT_PX * px)
    foreign = (
        (shown & ~known).sum() > _FOREIGN_SHARE * shown.sum()
        and (mask & known).sum() > mask.sum() / 2  # or else it is the picture that is not read
        and not MaskShape.of(*found).several_ropes
    )
    if not (ragged or foreign or MaskShape.of(mask, objects).several_ropes):
        return kept
    # Pixels of the ball found in the picture are not added to the rope, also where the given ball
    # is in another place.
    added = seen if objects is None else found[0]
    rope = added & _near(shown, _REACH_PX * px) | mask & known
    if objects is None:
        return rope, None
    ball = _near(~_near(mask | ~objects, _BALL_PX * px), _BALL_PX * px)
    return rope & ~_near(ball, _BALL_RIM_PX * px), rope | ball


def _uneven(mask: Mask, px: float) -> bool:
    """Return whether a strip's half-width deviates much, on average, from that of one on a table.

    A camera above a table sees it, as the table's inverse depth, as a linear function of the place.
    """
    depth = _distance_to(~mask)
    middle = mask & (depth >= cv2.dilate(depth, np.ones((3, 3))))
    half = depth[middle].astype(np.float64)
    places = np.column_stack([*np.nonzero(middle), np.ones(len(half))])
    usual = places @ np.linalg.lstsq(places, half, rcond=None)[0]
    most = max(_UNEVEN_PX * px, _UNEVEN_SHARE * float(np.median(half)))
    return float(np.abs(half - usual).mean()) >= most


def _contour_distance(first: Mask, second: Mask, most: float) -> float:
    """Return the mean distance of the first contour from the second, each at most `most`."""
    away = _distance_to(_contour(second))[_contour(first)]
    return float(np.minimum(away, most).mean()) if len(away) else 0.0


def _contour(mask: Mask) -> Mask:
    return mask & ~(cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)


def _near(mask: Mask, distance: float) -> Mask:
    return np.asarray(_distance_to(mask) <= distance)


def _distance_to(mask: Mask) -> npt.NDArray[Any]:
    """Return every pixel's distance to a mask, pixels; large where the mask is empty."""
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
