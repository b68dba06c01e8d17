"""The ball in a mask, on drawn ropes, cloths and edge cases."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from pliant.spec.arrays import Mask
from pliant.spec.ball import separate_ball
from tests.drawn_strands import drawn

ROWS, COLUMNS = np.mgrid[:240, :320] + 0.5
HALF_PX = 4.0
RAGGED = np.random.default_rng(0).random(ROWS.shape)


def disc(u: float, v: float, radius_px: float) -> Mask:
    return np.asarray(np.hypot(COLUMNS - u, ROWS - v) <= radius_px)


def along(u: npt.NDArray[np.float64], v: npt.NDArray[np.float64]) -> Mask:
    return drawn(np.stack([u, v], axis=1), HALF_PX, (240, 320))


def rope(shape: str) -> Mask:
    t = np.linspace(0, 1, 250)
    if shape == "wave":
        return along(40 + 240 * t, 120 + 45 * np.sin(7 * t))
    if shape == "loop":
        turn = 7.6 * t - 3.8
        return along(160 + 28 * turn - 62 * np.sin(turn), 120 + 55 * np.cos(turn))
    return along(40 + 240 * t, 120 + 0 * t) | along(90 + 120 * t, 127 + 0 * t)  # side by side


@pytest.mark.parametrize("shape", ["wave", "loop"])
@pytest.mark.parametrize("radius_px", [10.0, 14.0, 20.0])
def test_the_ball_is_what_was_drawn(shape: str, radius_px: float) -> None:
    strand = rope(shape)
    v, u = np.argwhere(strand)[np.argwhere(strand)[:, 1].argmin()]
    drawn = disc(u, v, radius_px)
    found, ball = separate_ball(strand | drawn)
    assert ball is not None
    assert (ball & drawn).sum() > 0.88 * (ball | drawn).sum()
    np.testing.assert_array_equal(found | ball, strand | drawn)
    assert not (found & ball).any()


def test_small_holes_do_not_hide_the_ball() -> None:
    """Depth cameras leave holes, next to which a rope seems thinner than it is."""
    drawn = disc(40, 120, 13)
    whole = rope("wave") | drawn
    pierced = whole & (np.random.default_rng(0).random(whole.shape) > 0.03)
    found, ball = separate_ball(pierced)
    assert ball is not None
    assert (ball & drawn).sum() > 0.8 * drawn.sum()
    np.testing.assert_array_equal(found | ball, pierced)


@pytest.mark.parametrize("shape", ["wave", "loop", "side by side"])
def test_a_rope_without_a_ball_stays_whole(shape: str) -> None:
    mask = rope(shape)
    found, ball = separate_ball(mask)
    assert ball is None
    np.testing.assert_array_equal(found, mask)


@pytest.mark.parametrize(
    "mask",
    [
        np.zeros((20, 30), np.bool_),
        np.ones((20, 30), np.bool_),
        np.ones((1, 1), np.bool_),
        disc(100, 100, 50),  # a ball alone
        (np.abs(ROWS - 120) < 60) & (np.abs(COLUMNS - 160) < 80),  # a cloth
        np.maximum(np.abs(ROWS - 120), np.abs(COLUMNS - 160)) < 60 + 5 * RAGGED,
    ],
    ids=["empty", "full", "pixel", "disc", "cloth", "ragged cloth"],
)
def test_what_is_no_rope_stays_whole(mask: Mask) -> None:
    found, ball = separate_ball(mask)
    assert ball is None
    np.testing.assert_array_equal(found, mask)
