"""Traces moved to the middle of a drawn rope, and a camera's small tilt from a rope's widths."""

import numpy as np
import pytest

from pliant.baselines.tracing.centring import centred, evenly_spaced
from pliant.baselines.tracing.tilt import Nadir, small_tilt
from tests.drawn_strands import drawn

HALF_PX = 5.0
SIZE = (240, 320)


def wave() -> np.ndarray:
    u = np.linspace(30, 290, 300)
    return np.stack([u, 120 + 25 * np.sin(u / 35)], axis=1)


def gap_px(trace: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Return how far the inner stations of a trace are from a line."""
    return np.linalg.norm(trace[10:-10, None] - line[None], axis=2).min(axis=1)


def test_a_wandering_trace_comes_to_the_middle() -> None:
    line = wave()
    wandering = line + np.stack([np.zeros(300), 2.5 * np.sin(np.arange(300) / 6)], axis=1)
    both = centred([wandering], drawn(line, HALF_PX, SIZE), 4.0)
    assert np.sqrt(np.mean(gap_px(wandering, line) ** 2)) > 1.2
    assert np.sqrt(np.mean(gap_px(both.places_px[0], line) ** 2)) < 0.35
    assert abs(both.usual_px - 2 * HALF_PX) < 0.6


def test_a_trace_goes_straight_through_a_crossing_strand() -> None:
    """Where another strand crosses at a flat angle, the mask is up to twice as wide."""
    line = np.stack([np.linspace(30, 290, 300), np.full(300, 120.0)], axis=1)
    other = np.stack([np.linspace(30, 290, 300), np.linspace(60, 160, 300)], axis=1)
    mask = drawn(line, HALF_PX, SIZE) | drawn(other, HALF_PX, SIZE)
    (found,) = centred([line], mask, HALF_PX).places_px
    assert gap_px(found, line).max() < 1.5


def test_a_trace_off_the_mask_stays() -> None:
    line = np.stack([np.linspace(30, 290, 300), np.full(300, 20.0)], axis=1)
    found = centred([line], drawn(wave(), HALF_PX, SIZE), HALF_PX)
    np.testing.assert_allclose(found.places_px[0], line)
    assert found.usual_px == 2 * HALF_PX


def test_even_spacing_is_that_on_the_table() -> None:
    """A level path, with a table nearer to the camera on the right: steps grow with the scale."""
    nadir = Nadir(np.array([100.0, 0.0]), 100.0, np.array([0.5, 0.0]))  # scale 0.5 to 1.5
    path = np.stack([np.linspace(0, 200, 2001), np.zeros(2001)], axis=1)
    places, length_px = evenly_spaced(path, 11, nadir)
    # The length in px of scale 1 is the integral of 1 / (1 + 0.5 (u - 100) / 100) over u.
    np.testing.assert_allclose(length_px, 200 * np.log(3), rtol=1e-4)
    scale = 0.5 * 3 ** (np.arange(11) / 10)
    np.testing.assert_allclose(places[:, 0], 200 * (scale - 0.5), atol=0.01)


NADIR = Nadir(np.array([320.0, 240.0]), 685.0)


def ring(tilt: np.ndarray, noise_px: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places, normals and widths of a rope in a circle of 180 px, a third hidden."""
    angle = np.linspace(0, 4 * np.pi / 3, 400)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    place = NADIR.place_px + 180 * normal
    aside = 180 / 685
    width = 11 * (1 + (normal * aside) @ tilt) * np.sqrt(1 + aside**2)  # the normal is radial
    return place, normal, width + noise_px * np.random.default_rng(1).standard_normal(400)


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.06, 0.0), (-0.03, 0.05)])
def test_widths_show_the_tilt(tilt: tuple[float, float]) -> None:
    found = small_tilt(*ring(np.array(tilt), 0.05), NADIR, copies=1.0)
    assert found == pytest.approx(tilt, abs=0.005)


def test_a_tilt_that_noise_hides_is_drawn_to_zero() -> None:
    true = np.array([0.06, 0.0])
    clear, vague = (small_tilt(*ring(true, noise), NADIR, copies=3.0) for noise in (0.05, 4.0))
    assert np.linalg.norm(vague) < 0.5 * np.linalg.norm(clear)


def test_too_few_places_show_none() -> None:
    place, normal, width = ring(np.array([0.06, 0.0]), 0.0)
    np.testing.assert_array_equal(small_tilt(place[:39], normal[:39], width[:39], NADIR, 1.0), 0)
