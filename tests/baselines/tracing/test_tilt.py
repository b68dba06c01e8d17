"""A camera's small tilt from widths that are computed here from a projected cylinder."""

import numpy as np
import pytest

from pliant.baselines.tracing.tilt import Nadir, small_tilt

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
