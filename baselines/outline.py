"""Baselines for cloth: its places by the four corners, or the whole outline, of its mask."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.features.opencv_features import load_opencv
from pliant.baselines.pixels import HALF_PIXEL, central_position
from pliant.baselines.remarks import cut_object_remarks, unread_remarks
from pliant.spec.answers import Answers
from pliant.spec.arrays import FloatArray
from pliant.spec.frame import Frame, Pair
from pliant.spec.lru_cache import LRUCache

PLACES_PER_SIDE: Final = 12
"""Places on each side of the outline that the thin-plate spline goes through."""

UPRIGHT: Final = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""Directions of an upright cloth's corners from its middle, clockwise in the picture."""

LEAST_ALIGNED: Final = 0.5
"""Least agreement of a cloth's edges modulo a quarter turn, 0 to 1, that says how it is turned. Of
own renders, all cloths of the tier `cloth-1` have more, and half of `cloth-2`."""

_STRAIGHT: Final = 0.02
"""Distance of an outline from the straight edges that stand for it, over the root of its area."""

_KEPT_VIEWS: Final = 8


def outline_sides(cv2: Any, mask: npt.NDArray[np.bool_]) -> FloatArray | None:
    """Return the four sides of a mask's largest part, or None where it has no four corners.

    The corners are those of the convex hull that are left when the corner with the smallest
    triangle is taken away again and again. A blank cloth has no other mark of its orientation: of
    the four ways to name the corners, the one closest to upright is taken, which is right for a
    cloth turned by less than 45 degrees.

    Args:
        cv2: The OpenCV module.
        mask: bool (H, W).

    Returns:
        float64 (4, `PLACES_PER_SIDE`, 2): top, right, bottom and left side, each from its corner at
        equal distances along the outline; centre of the first pixel at (0.5, 0.5).
    """
    if (largest := _largest_contour(cv2, mask)) is None:
        return None
    corners = _four_corners(np.sort(cv2.convexHull(largest, returnPoints=False)[:, 0]), largest)
    if corners is None:
        return None
    contour = largest.astype(np.float64) + HALF_PIXEL
    if _area(contour[corners]) < 0:
        contour, corners = contour[::-1], np.sort(len(contour) - 1 - corners)
    spread = contour[corners] - contour[corners].mean(axis=0)
    fit = [(np.roll(spread, -first, axis=0) * UPRIGHT).sum() for first in range(4)]
    first = int(np.argmax(fit))
    contour = np.roll(contour, -corners[first], axis=0)
    corners = np.sort((corners - corners[first]) % len(contour))
    closed = np.concatenate([contour, contour[:1]])
    length = np.concatenate([[0.0], np.hypot(*np.diff(closed, axis=0).T).cumsum()])
    stops = length[[*corners, -1]]
    share = np.arange(PLACES_PER_SIDE) / PLACES_PER_SIDE
    at = stops[:-1, None] + share * np.diff(stops)[:, None]  # (4, PLACES_PER_SIDE)
    return np.stack([np.interp(at, length, closed[:, axis]) for axis in (0, 1)], axis=-1)


def angle_from_upright(cv2: Any, mask: npt.NDArray[np.bool_]) -> float | None:
    """Return by which angle a square cloth is turned from upright, or None if its edges disagree.

    Each straight edge of the outline of the mask's largest part votes for its direction modulo a
    quarter turn, with its length squared. A folded corner adds an edge at 45 degrees, but leaves
    the others as they were; the smallest rectangle around the mask would be wrong there.

    Args:
        cv2: The OpenCV module.
        mask: bool (H, W).

    Returns:
        -pi / 4 to pi / 4 radians, from right to down; None where the votes agree by less than
        `LEAST_ALIGNED`.
    """
    if (largest := _largest_contour(cv2, mask)) is None:
        return None
    within_px = _STRAIGHT * np.sqrt(cv2.contourArea(largest))
    polygon = cv2.approxPolyDP(largest, within_px, True)[:, 0].astype(np.float64)
    u, v = (np.roll(polygon, -1, axis=0) - polygon).T
    edges = u + 1j * v
    squared = np.abs(edges) ** 2
    if squared.sum() == 0:
        return None
    vote = (squared * np.exp(4j * np.angle(edges))).sum() / squared.sum()
    return None if abs(vote) < LEAST_ALIGNED else float(np.angle(vote) / 4)


def _largest_contour(cv2: Any, mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.int32] | None:
    """Return the contour of a mask's largest part, (N, 2), or None where the mask is empty."""
    parts, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return max(parts, key=cv2.contourArea)[:, 0] if parts else None


def _area(polygon: FloatArray) -> float:
    """Return the signed area of a polygon, positive if clockwise in the picture."""
    u, v = polygon.T
    return float((u * np.roll(v, -1) - np.roll(u, -1) * v).sum() / 2)


def _four_corners(
    rows: npt.NDArray[Any], contour: npt.NDArray[Any]
) -> npt.NDArray[np.int64] | None:
    """Return the rows of the four corners among the rows of a contour's hull, ascending."""
    rows = rows.astype(np.int64)
    while len(rows) > 4:
        at = contour[rows].astype(np.float64)
        before, after = np.roll(at, 1, axis=0) - at, np.roll(at, -1, axis=0) - at
        triangle = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
        rows = np.delete(rows, triangle.argmin())
    four = len(rows) == 4 and abs(_area(contour[rows].astype(np.float64))) >= 1
    return rows if four else None


def _thin_plate(source: FloatArray, target: FloatArray, uv_px: FloatArray) -> FloatArray:
    """Carry places by the thin-plate spline through the outline (Bookstein, PAMI 1989)."""
    from scipy.interpolate import RBFInterpolator  # it takes half a second

    spline = RBFInterpolator(
        source.reshape(-1, 2), target.reshape(-1, 2), kernel="thin_plate_spline"
    )
    moved: FloatArray = spline(uv_px)
    return moved


class ClothOutline:
    """Thin-plate spline through the outline of a cloth's mask.

    Where a mask is missing or has no four corners, the answer is the middle of the target.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """

    name = "cloth-tps"

    def __init__(self) -> None:
        load_opencv(self.name)
        self._sides: LRUCache[FloatArray | None] = LRUCache(_KEPT_VIEWS)

    def describe(self) -> Mapping[str, Any]:
        """Return name and settings for the submission's footer."""
        return {
            "name": self.name,
            "places_per_side": PLACES_PER_SIDE,
            "orientation": "the one closest to upright",
        }

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels; see `Matcher`."""
        source, target, uv_a_px = pair.source, pair.target, pair.uv_a_px
        a, b = self._of(source), self._of(target)
        uv_b_px = np.tile(central_position(target), (len(uv_a_px), 1))  # (N, 2)
        if a is not None and b is not None and len(uv_a_px):
            moved = _thin_plate(a, b, uv_a_px.astype(np.float64))
            finite = np.isfinite(moved).all(axis=1)
            uv_b_px[finite] = moved[finite].clip(0, target.rgb.shape[1::-1])
        return Answers(uv_b_px)

    def remarks(self, source: Frame, target: Frame) -> list[str]:
        """Return what should be known of two pictures, as sentences; see `RemarkingMatcher`."""
        read = (self._of(view) is not None for view in (source, target))
        unread = unread_remarks(read, self.name, "with four corners", "cloth")
        return unread or cut_object_remarks((source.mask, target.mask))

    def _of(self, view: Frame) -> FloatArray | None:
        mask = view.mask
        if mask is None:
            return None
        return self._sides.get(view.cache_key, lambda: outline_sides(load_opencv(self.name), mask))
