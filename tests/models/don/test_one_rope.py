"""Telling one rope from cables in a mask, on pictures drawn here."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.tracing import MaskShape
from pliant.models.don.one_rope import of_one_rope
from pliant.spec.arrays import Mask
from tests.drawn_strands import SIZE, U, V, drawn
from tests.models.don.test_segmentation import encoded, overlap

S = np.linspace(0, 1, 2000)
WAVE = np.stack([60 + 520 * S, 240 + 90 * np.sin(2 * np.pi * S)], axis=1)
CROSSING = np.stack([250 + 60 * S, 60 + 360 * S], axis=1)
APART = np.stack([80 + 300 * S, 430 + 20 * np.sin(4 * S)], axis=1)
TABLE, ROPE, CABLE = (120, 120, 120), (200, 170, 60), (40, 60, 160)


def painted(*parts: tuple[Mask, tuple[int, int, int]]) -> np.ndarray:
    """A table with things on it, each over those before it, with a little noise."""
    rgb = np.full((*SIZE, 3), TABLE, float)
    for mask, colour in parts:
        rgb[mask] = colour
    noise = np.random.default_rng(0).normal(0, 4, rgb.shape)
    return np.asarray((rgb + noise).clip(0, 255).astype(np.uint8))


def with_light(rgb: np.ndarray, share: float) -> np.ndarray:
    """Colours, uint8, where only a share of the light is left, by the curve of sRGB."""
    value = rgb / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return encoded(share * linear)


@pytest.mark.parametrize(("half_px", "colour"), [(7.0, CABLE), (3.5, CABLE), (3.5, ROPE)])
def test_cables_of_another_colour_or_width_go(half_px: float, colour: tuple[int, int, int]) -> None:
    rope = drawn(WAVE, 7.0)
    cables = drawn(CROSSING, half_px) | drawn(APART, half_px)
    found, ball = of_one_rope(painted((cables, colour), (rope, ROPE)), rope | cables, None)
    assert overlap(found, rope) > 0.93
    assert ball is None


def test_the_edge_of_a_shadow_does_not_divide_a_rope() -> None:
    rope, cable = drawn(WAVE, 7.0), drawn(CROSSING, 7.0)
    rgb = painted((cable, CABLE), (rope, ROPE))
    shaded = U[0] < 320
    rgb[:, shaded] = with_light(rgb[:, shaded], 0.2)
    found, _ = of_one_rope(rgb, rope | cable, None)
    assert overlap(found, rope) > 0.93


def test_the_rope_at_the_ball_is_taken_though_it_is_smaller() -> None:
    rope, other = drawn(APART, 7.0), drawn(WAVE, 7.0)
    ball = np.hypot(U - APART[0, 0], V - APART[0, 1]) < 17
    rope &= ~ball
    rgb = painted((other, CABLE), (rope, ROPE), (ball, (220, 30, 30)))
    found, kept = of_one_rope(rgb, rope | other, ball)
    assert overlap(found, rope) > 0.93
    assert kept is ball
    found, _ = of_one_rope(rgb, rope | other, None)
    assert overlap(found, other) > 0.93


def test_what_is_not_round_is_no_ball() -> None:
    rope, other = drawn(WAVE, 7.0), drawn(APART, 5.0)
    corner = (U > 560) & (U < 640) & (V > 20) & (V < 50)
    rgb = painted((other, CABLE), (rope, ROPE), (corner, (220, 30, 30)))
    found, kept = of_one_rope(rgb, rope | other, corner)
    assert kept is None
    assert overlap(found, rope) > 0.93


def test_the_mask_of_one_rope_is_not_touched() -> None:
    """Also where its two halves have other colours."""
    rope = drawn(WAVE, 7.0)
    rgb = painted((rope, ROPE), (rope & (U > 320), CABLE))
    found, _ = of_one_rope(rgb, rope, None)
    assert found is rope


def test_a_rope_under_a_cloth_keeps_both_its_parts() -> None:
    rope = drawn(WAVE, 7.0) & (np.abs(U - 300) > 50)
    cable = drawn(APART, 4.0)
    found, _ = of_one_rope(painted((rope, ROPE), (cable, CABLE)), rope | cable, None)
    assert overlap(found, rope) > 0.93


def test_slits_between_the_colours_of_a_twisted_rope_do_not_divide_it() -> None:
    """Of the second colour, which is that of the table, slits are left out of the mask."""
    rope, cable = drawn(WAVE, 8.0), drawn(APART, 5.0)
    slits = (U + V) % 20 < 5
    seen = rope & ~slits | drawn(WAVE, 1.2)
    rgb = painted((cable, CABLE), (rope, ROPE), (rope & slits, TABLE))
    found, _ = of_one_rope(rgb, seen | cable, None)
    assert overlap(found, seen) > 0.93


def test_a_cable_on_the_end_of_a_rope_goes_though_both_could_be_one_rope() -> None:
    rope, cable = drawn(WAVE, 7.0), drawn(WAVE[-1] + (WAVE[0] - WAVE[-1]) * 0.6 * S[:, None], 7.0)
    rope &= U > 200
    cable &= ~rope
    rgb = painted((rope, ROPE), (cable, CABLE))
    assert not MaskShape.of(rope | cable).several_ropes
    found, _ = of_one_rope(rgb, rope | cable, None)
    assert overlap(found, rope) > 0.9


def test_a_thin_cable_on_a_rope_goes_though_it_is_small() -> None:
    """With a ball, two loose ends could be those of one rope."""
    rope, cable = drawn(WAVE, 10.0), drawn(WAVE[1900] - S[:, None] * [40, 150], 3.0)
    ball = np.hypot(U - WAVE[0, 0], V - WAVE[0, 1]) < 25
    rope &= ~ball
    cable &= ~rope
    assert not MaskShape.of(rope | cable, rope | cable | ball).several_ropes
    assert cable.sum() < 0.1 * rope.sum()
    rgb = painted((rope, ROPE), (cable, CABLE), (ball, (220, 30, 30)))
    found, _ = of_one_rope(rgb, rope | cable, ball)
    assert (found & cable).sum() < 0.2 * cable.sum()
    assert (found & rope).sum() > 0.97 * rope.sum()


def test_small_parts_stay_where_they_look_like_the_rope() -> None:
    """The end of a covered rope, and a speck of something else."""
    rope = drawn(WAVE, 7.0)
    cover = (np.abs(U - 520) < 54) | (np.abs(U - 260) < 30)
    stub, speck = rope & (U > 574), drawn(CROSSING[:160], 7.0)
    rgb = painted((speck, CABLE), (rope, ROPE), (cover, TABLE))
    found, _ = of_one_rope(rgb, rope & ~cover | speck, None)
    assert found[stub].all()
    assert not found[speck].any()
