"""The ball of a rope is found by its thickness and by what a network says of the place."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from pliant.models.don.ball import ball_in
from pliant.spec.arrays import FloatArray, Mask

HEIGHT, WIDTH, HALF_PX = 120, 160, 3.0
ENDS = {"left": (60, 20), "right": (60, 140)}  # (row, column)


def disc(row: int, column: int, radius_px: float) -> Mask:
    rows, columns = np.indices((HEIGHT, WIDTH))
    return np.asarray(np.hypot(rows - row, columns - column) <= radius_px)


def drawn() -> Mask:
    """Return a straight rope with a knot, thicker than a ball, in its middle."""
    line = np.ones((HEIGHT, WIDTH), dtype=np.bool_)
    line[60, 20:141] = False
    return np.asarray(ndimage.distance_transform_edt(line) <= HALF_PX) | disc(60, 80, 7)


def likely(mask: Mask) -> FloatArray:
    return np.asarray(0.7 * ndimage.gaussian_filter(mask.astype(np.float64), 1.0))


def even(value: float) -> FloatArray:
    return np.full((HEIGHT, WIDTH), value)


@pytest.mark.parametrize("end", ENDS)
def test_the_ball_is_where_the_network_sees_no_rope(end: str) -> None:
    ball = disc(*ENDS[end], 6)
    rope = drawn() & ~ball
    found = ball_in(rope | ball, likely(rope), even(0.5))
    assert (found & ball).sum() > 0.7 * (found | ball).sum()


def test_of_two_ends_alike_the_ball_is_at_the_first_one() -> None:
    balls = {end: disc(*place, 6) for end, place in ENDS.items()}
    rope = drawn() & ~balls["left"] & ~balls["right"]
    first = even(0.05)
    first[:, WIDTH // 2 :] = 0.9
    found = ball_in(rope | balls["left"] | balls["right"], likely(rope), first)
    assert (found & balls["right"]).any()
    assert not (found & balls["left"]).any()


def test_a_crossing_of_a_rope_without_a_ball_is_none() -> None:
    crossed = drawn() & ~disc(60, 80, 7) | disc(60, 80, 4)
    assert not ball_in(crossed, likely(crossed), even(0.5)).any()


@pytest.mark.parametrize("end", ENDS)
def test_a_ball_that_the_mask_lacks_is_beyond_the_end_that_is_surely_first(end: str) -> None:
    rope, ball = drawn() & ~disc(60, 80, 7) | disc(60, 80, 4), disc(*ENDS[end], 10.5)
    first = even(0.0)
    near = slice(0, 50) if end == "left" else slice(110, None)
    first[:, near] = 1.0
    assert not ball_in(rope, likely(rope), 0.8 * first).any()
    found = ball_in(rope, likely(rope), first)
    assert 0.7 * ball.sum() < found.sum() < 1.3 * ball.sum()
    assert (found & ball).sum() > 0.2 * ball.sum()
    assert (found & rope).sum() < 0.1 * rope.sum()


def test_an_empty_mask_has_none() -> None:
    assert not ball_in(np.zeros((HEIGHT, WIDTH), dtype=np.bool_), even(0.0), even(0.0)).any()
