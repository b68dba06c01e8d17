"""Places carried from rope to rope, against projections of a cylinder on a table."""

import numpy as np
import pytest

from pliant.baselines.tracing import Nadir, Trace, located, placed

FOCAL_PX, HEIGHT_M, RADIUS_M = 700.0, 1.4, 0.011
MIDDLE_PX = np.array([320.0, 240.0])


def projected(points_m: np.ndarray) -> np.ndarray:
    """Return pixels of points (N, 3) seen by a camera straight above the origin, y down."""
    depth = HEIGHT_M - points_m[:, 2]
    return MIDDLE_PX + FOCAL_PX * points_m[:, :2] / depth[:, None]


def rope(start_m: np.ndarray, way: np.ndarray) -> tuple[Trace, np.ndarray, np.ndarray]:
    """Return the trace of a straight rope of 0.4 m, its axis and the vector to its left."""
    axis = np.column_stack([start_m + np.linspace(0, 0.4, 300)[:, None] * way, np.zeros(300)])
    axis[:, 2] = RADIUS_M
    line = projected(axis)
    length_px = float(np.linalg.norm(line[-1] - line[0]))
    half_px = FOCAL_PX * RADIUS_M / (HEIGHT_M - RADIUS_M)
    nadir = Nadir(MIDDLE_PX, FOCAL_PX)
    left = np.array([-way[1], way[0], 0.0])
    return Trace(line, length_px, half_px, 1.0, 0.0, nadir), axis, left


def on_surface(axis: np.ndarray, left: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return points at angles from the highest line of a rope, every 20th station."""
    up = np.array([0.0, 0.0, 1.0])
    normal = np.cos(angle)[:, None] * up + np.sin(angle)[:, None] * left
    return axis[::20] + RADIUS_M * normal


@pytest.mark.parametrize(
    ("start_m", "way"), [((0.45, -0.2), (0.0, 1.0)), ((0.1, 0.3), (-0.8, 0.6))]
)
def test_a_place_keeps_its_angle_around_the_rope(
    start_m: tuple[float, float], way: tuple[float, float]
) -> None:
    source, axis_a, left_a = rope(np.array([-0.45, -0.2]), np.array([0.0, 1.0]))
    target, axis_b, left_b = rope(np.array(start_m), np.array(way))
    angle = np.linspace(-0.7, 0.7, 15)
    uv_a = projected(on_surface(axis_a, left_a, angle))
    uv_b = projected(on_surface(axis_b, left_b, angle))
    found = placed(target, located(source, uv_a))
    assert np.linalg.norm(found - uv_b, axis=1).max() < 0.45
    offset = ((uv_a - source.uv_px[::20]) * source.axes[::20, 1]).sum(axis=1)
    same_offset = target.uv_px[::20] + offset[:, None] * target.axes[::20, 1]
    assert np.linalg.norm(same_offset - uv_b, axis=1).max() > 1.2


def test_places_off_the_body_stay_off_it() -> None:
    source, _, _ = rope(np.array([0.0, -0.2]), np.array([0.0, 1.0]))  # lean 0
    beside = source.uv_px[::50] + 2 * source.half_px * source.axes[::50, 1]
    np.testing.assert_allclose(placed(source, located(source, beside)), beside, atol=1e-6)
