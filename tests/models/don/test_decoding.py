"""Positions and modes of a distribution, worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from pliant.models.don.certainty import Decode, Widths, decode_position, mixture_of_modes

GRID = torch.tensor([[u + 0.5, v + 0.5] for v in range(6) for u in range(10)])


def likely(weights: dict[int, float]) -> torch.Tensor:
    """Return log p of one query over 60 pixels, float (1, 60)."""
    p = torch.full((1, 60), 1e-12)
    for pixel, weight in weights.items():
        p[0, pixel] = weight
    return p.log()


PULLED = {23: 0.5, 24: 0.25, 59: 0.25}
"""The most probable pixel, (3.5, 2.5), has one likely neighbour."""
PEAK_AND_HILL = {0: 0.28, 57: 0.24, 58: 0.24, 59: 0.24}


@pytest.mark.parametrize(
    ("weights", "how", "place"),
    [
        (PULLED, "argmax", [3.5 + 1 / 3, 2.5]),
        (PULLED, "soft", [5.25, 3.25]),
        (PEAK_AND_HILL, "median", [8.5, 5.5]),
        (PEAK_AND_HILL, "argmax", [0.5, 0.5]),
    ],
)
def test_positions_by_hand(weights: dict[int, float], how: Decode, place: list[float]) -> None:
    found = decode_position(likely(weights), GRID, how)[0]
    assert found.tolist() == pytest.approx(place, abs=1e-6)


TWO_NEAR = {9: 0.3, 11: 0.3, 40: 0.4}
"""Pixel 40 is the highest; then 9 and 11 share a mode, of variance 1 / 2 per axis."""
SIX_APART = {20: 0.5, 26: 0.3, 50: 0.2}
"""Within 9 px the first two are one mode: mean 20 + 6 * 3 / 8, variance 36 * 15 / 64 along u."""


@pytest.mark.parametrize(
    ("weights", "widths", "radius_px", "modes"),
    [
        (TWO_NEAR, Widths(0.5), 4.0, [[40.5, 0.5, 0.4], [10.5, math.sqrt(0.5 + 0.25), 0.6]]),
        # A narrower spread moves neither modes nor weights; a single pixel has none to shrink.
        (TWO_NEAR, Widths(0.5, 0.5), 4.0, [[40.5, 0.5, 0.4], [10.5, math.sqrt(0.375), 0.6]]),
        (SIX_APART, Widths(0.0), 4.0, [[20.5, 0, 0.5], [26.5, 0, 0.3], [50.5, 0, 0.2]]),
        (SIX_APART, Widths(0.0), 9.0, [[22.75, math.sqrt(36 * 15 / 128), 0.8], [50.5, 0, 0.2]]),
    ],
)
def test_modes_by_hand(
    weights: dict[int, float], widths: Widths, radius_px: float, modes: list[list[float]]
) -> None:
    line = torch.tensor([[u + 0.5, 0.5] for u in range(60)])
    found, used = mixture_of_modes(likely(weights), line, widths, radius_px)
    shown = found[0][used[0]].numpy()
    np.testing.assert_allclose(shown[:, [0, 2, 3]], modes, atol=1e-4)
    np.testing.assert_allclose(shown[:, 1], 0.5, atol=1e-4)


def test_the_blur_of_the_target_comes_off() -> None:
    variance = torch.tensor([4.0, 2.25, 1.0])
    found = Widths(0.5, 2.0, 1.5).of(variance)
    # 4 (4 - 2.25) + 0.25 = 7.25; nothing is left of the others but a hundredth.
    expected = [math.sqrt(7.25), math.sqrt(4 * 0.0225 + 0.25), math.sqrt(4 * 0.01 + 0.25)]
    assert found.tolist() == pytest.approx(expected, rel=1e-6)
    # Squared, a deviation of 2 px becomes 4 and one of half a pixel a quarter.
    apart = Widths(0.0, 1.0, 0.0, 2.0).of(torch.tensor([4.0, 0.25]))
    assert apart.tolist() == pytest.approx([4.0, 0.25], rel=1e-6)
