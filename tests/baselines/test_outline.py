"""Cloths whose corners and outline are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pliant.baselines import Frame
from pliant.baselines.outline import (
    ClothOutline,
    angle_from_upright,
    outline_sides,
)
from pliant.baselines.remarks import cut_object_remarks
from pliant.spec.arrays import FloatArray
from pliant.spec.frame import Pair
from tests.known import known

cv2: Any = pytest.importorskip("cv2")

Warp = Callable[[FloatArray], FloatArray]
SIZE = (240, 200)


def view_of(place: Warp) -> Frame:
    """A unit square carried to the picture, its outline filled."""
    t = np.linspace(-1, 1, 200)
    top = np.stack([t, np.full_like(t, -1)], axis=1)
    outline = np.concatenate([top, top[:, ::-1] * [-1, 1], -top, -top[:, ::-1] * [-1, 1]])
    mask = np.zeros(SIZE[::-1], dtype=np.uint8)
    cv2.fillPoly(mask, [np.rint(place(outline) - 0.5).astype(np.int32)], 1)
    return Frame(np.zeros((*mask.shape, 3), dtype=np.uint8), mask=mask > 0)


def turned(angle_deg: float, scale: float = 60.0, tilt: float = 0.0) -> Warp:
    def place(uv: FloatArray) -> FloatArray:
        angle = np.radians(angle_deg)
        matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return scale * (uv @ matrix.T) / (1 + tilt * uv[:, :1]) + [120.0, 100.0]

    return place


def bulged(uv: FloatArray) -> FloatArray:
    """A cloth whose sides bend inwards by 12 px, its corners in place."""
    inwards = np.stack([uv[:, 0] * (1 - uv[:, 1] ** 2), uv[:, 1] * (1 - uv[:, 0] ** 2)], axis=1)
    return uv * 60 - 12 * inwards + [120.0, 100.0]


INSIDE = np.random.default_rng(0).uniform(-0.8, 0.8, (50, 2))


@pytest.mark.parametrize("angle_deg", [-40, 0, 17, 40])
def test_a_flat_cloth_is_carried_through_a_turn(angle_deg: float) -> None:
    a, b = turned(-35), turned(angle_deg, scale=50)
    answers = ClothOutline().answer(Pair(view_of(a), view_of(b), a(INSIDE).astype(np.float32)))
    assert np.hypot(*(answers.uv_px - b(INSIDE)).T).max() < 2.5


def test_the_spline_follows_bent_sides() -> None:
    a = turned(0)
    near_side = np.stack([np.linspace(-0.3, 0.3, 9), np.full(9, 0.9)], axis=1)
    found = ClothOutline().answer(
        Pair(view_of(a), view_of(bulged), a(near_side).astype(np.float32))
    )
    assert np.hypot(*(found.uv_px - bulged(near_side)).T).max() < 3


def test_beyond_45_degrees_a_blank_cloth_is_named_by_its_nearest_upright_corner() -> None:
    """60 degrees look like -30: every corner is its neighbour's."""
    a, b = turned(0), turned(60)
    found = ClothOutline().answer(Pair(view_of(a), view_of(b), a(INSIDE).astype(np.float32)))
    assert np.hypot(*(found.uv_px - turned(-30)(INSIDE)).T).max() < 2.5


def test_sides_start_at_the_top_left_and_go_clockwise() -> None:
    mask = np.zeros((40, 50), dtype=np.bool_)
    mask[10:31, 5:46] = True
    mask[0, 0] = True  # a speck elsewhere
    sides = known(outline_sides(cv2, mask))
    expected = [[5.5, 10.5], [45.5, 10.5], [45.5, 30.5], [5.5, 30.5]]
    np.testing.assert_allclose(sides[:, 0], expected)
    np.testing.assert_allclose(sides[0, 6], [25.5, 10.5])


def test_masks_without_four_corners_are_answered_by_the_middle() -> None:
    rgb = np.zeros((40, 50, 3), dtype=np.uint8)
    full = view_of(turned(0))
    query = np.array([[20, 20]], dtype=np.float32)
    speck = np.zeros((40, 50), dtype=np.bool_)
    speck[3, 7:9] = True
    for mask, middle in ((None, [25, 20]), (speck & False, [25, 20]), (speck, [8, 3.5])):
        unread = Frame(rgb, mask=mask)
        answers = ClothOutline().answer(Pair(full, unread, query))
        assert answers.uv_px.tolist() == [middle]
        (remark,) = ClothOutline().remarks(full, unread)
        assert remark.startswith("The target has no mask with four corners, so cloth-tps answers")
    assert ClothOutline().remarks(full, full) == []


def test_an_object_that_leaves_its_picture_is_reported() -> None:
    whole = view_of(turned(0))
    mask = known(whole.mask)
    left = mask.any(axis=0).argmax() + 5
    cut = Frame(whole.rgb[:, left:], mask=mask[:, left:])
    (remark,) = ClothOutline().remarks(whole, cut)
    assert remark.startswith("The object leaves the picture of the target: ")
    corner = np.zeros_like(mask)
    corner[:2, :2] = True  # touches the border
    assert cut_object_remarks((mask | corner, None)) == []


@pytest.mark.parametrize("angle_deg", [-40, -10, 0, 3, 33])
def test_the_angle_of_a_flat_cloth_is_that_of_the_rectangle_around_it(angle_deg: float) -> None:
    mask = known(view_of(turned(angle_deg)).mask)
    found = known(angle_from_upright(cv2, mask))
    assert np.degrees(found) == pytest.approx(angle_deg, abs=1.5)


@pytest.mark.parametrize("angle_deg", [0.0, 21.0, -40.0])
def test_a_slanted_fold_hardly_turns_a_cloth(angle_deg: float) -> None:
    """Three edges against the fold, which is 20 degrees from them; the smallest rectangle fails."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, -0.4], [-1.0, 0.33]])
    place = turned(angle_deg)
    mask = np.zeros(SIZE[::-1], dtype=np.uint8)
    cv2.fillPoly(mask, [np.rint(place(corners) - 0.5).astype(np.int32)], 1)
    found = known(angle_from_upright(cv2, mask > 0))
    gap = (np.degrees(found) - angle_deg + 45) % 90 - 45
    assert abs(gap) < 10


def test_a_cloth_that_is_not_flat_has_no_angle() -> None:
    mask = np.tri(*SIZE[::-1], dtype=np.bool_)
    assert angle_from_upright(cv2, mask) is None
    assert angle_from_upright(cv2, np.zeros_like(mask)) is None
