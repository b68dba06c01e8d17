from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pliant.generator.truth.rasteriser import interpolate, rasterise
from pliant.spec.camera import Camera

# Looks along +z from the origin: K maps (x, y, z) to (8 x / z + 8, 8 y / z + 8), 16 x 16 px.
AHEAD = Camera(np.array([[8.0, 0, 8], [0, 8.0, 8], [0, 0, 1]]), np.eye(4), (16, 16))


def test_a_triangle_worked_out_by_hand() -> None:
    # Corners at pixels (4, 4), (12, 4), (4, 12) and depth 2: rows shorten by a pixel each.
    points = np.array([[-1.0, -1, 2], [1, -1, 2], [-1, 1, 2]])
    hits = rasterise(AHEAD, points, np.array([[0, 1, 2]], np.int32))
    seen = hits.triangle >= 0
    assert seen.sum(axis=1).tolist() == [0, 0, 0, 0, 8, 7, 6, 5, 4, 3, 2, 1, 0, 0, 0, 0] or (
        seen.sum(axis=1).tolist() == [0, 0, 0, 0, 7, 6, 5, 4, 3, 2, 1, 0, 0, 0, 0, 0]
    )  # the hypotenuse passes through pixel centres; one rule decides them all
    np.testing.assert_allclose(hits.depth_m[seen], 2.0, rtol=1e-14)
    assert np.isinf(hits.depth_m[~seen]).all()
    # The centre of pixel (5, 6) is (5.5, 6.5): 1.5 / 8 along u and 2.5 / 8 along v.
    np.testing.assert_allclose(hits.weights[6, 5], [1.5 / 8, 2.5 / 8], rtol=1e-13)


def test_weights_are_those_in_space_not_in_the_image() -> None:
    # A wall from depth 1 (left) to depth 3 (right), 4 m high on both sides.
    points = np.array([[-0.5, -2, 1], [-0.5, 2, 1], [1.5, 2, 3], [1.5, -2, 3]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    hits = rasterise(AHEAD, points, faces)
    rows, columns = np.nonzero(hits.triangle >= 0)
    triangle, weights = hits.triangle[rows, columns], hits.weights[rows, columns]
    place = interpolate(triangle, weights, faces, points)
    # The plane is x = z - 1.5; a ray of slope dx meets it at z = 1.5 / (1 - dx).
    slope = (columns + 0.5 - 8) / 8
    np.testing.assert_allclose(hits.depth_m[rows, columns], 1.5 / (1 - slope), rtol=1e-12)
    np.testing.assert_allclose(place[:, 2], 1.5 / (1 - slope), rtol=1e-12)
    uvz = AHEAD.to_pixels(place)
    np.testing.assert_allclose(uvz[:, 0], columns + 0.5, atol=1e-11)
    np.testing.assert_allclose(uvz[:, 1], rows + 0.5, atol=1e-11)


@pytest.mark.parametrize("turns", range(4))
def test_a_tip_just_beyond_a_pixel_centre_covers_it(turns: int) -> None:
    turn = np.linalg.matrix_power(np.array([[0.0, 1], [-1, 0]]), turns)
    tip = np.array([[0.5 + 5e-7, 0.5], [-4, -4], [-4, 5]])  # px from the principal point
    points = np.column_stack([(tip - 0.5) @ turn + 0.5, np.full(3, 8.0)]) * [0.125, 0.125, 0.125]
    hits = rasterise(AHEAD, points, np.array([[0, 1, 2]], np.int32))
    assert hits.triangle[8, 8] == 0


def test_a_floor_passing_under_the_camera_needs_no_clipping() -> None:
    points = np.array([[-50.0, 1, -20], [50, 1, -20], [50, 1, 80], [-50, 1, 80]])
    hits = rasterise(AHEAD, points, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    below = np.arange(16) + 0.5 > 8
    assert (hits.triangle[below] >= 0).all()
    assert (hits.triangle[~below] < 0).all()
    expected = 1 / ((np.arange(16) + 0.5 - 8) / 8)[below]
    np.testing.assert_allclose(hits.depth_m[below][:, 3], expected, rtol=1e-12)


def test_behind_the_camera_nothing_is_seen() -> None:
    points = np.array([[-1.0, -1, -2], [1, -1, -2], [-1, 1, -2]])
    assert (rasterise(AHEAD, points, np.array([[0, 1, 2]], np.int32)).triangle < 0).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_a_shared_edge_is_covered_once(seed: int, snapped: bool) -> None:
    """A grid split at random gives each pixel to exactly one triangle, edges and corners too."""
    rng = np.random.default_rng(seed)
    side = 5
    u, v = np.meshgrid(np.linspace(0, 16, side), np.linspace(0, 16, side), indexing="ij")
    step = rng.uniform(-1.5, 1.5, (2, side, side))
    step[:, [0, -1]], step[:, :, [0, -1]] = 0, 0
    u, v = u + step[0], v + step[1]
    if snapped:  # corners and edges through pixel centres
        u, v = np.floor(u) + 0.5, np.floor(v) + 0.5
        u[0], v[:, 0], u[-1], v[:, -1] = -1, -1, 17, 17
    z = np.exp2(rng.integers(-1, 2, (side, side))).astype(float)
    points = np.stack([(u - 8) / 8 * z, (v - 8) / 8 * z, z], axis=-1).reshape(-1, 3)
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    if rng.random() < 0.5:
        halves = [np.stack([a, b, c], -1), np.stack([a, c, d], -1)]
    else:
        halves = [np.stack([a, b, d], -1), np.stack([b, c, d], -1)]
    faces = rng.permutation(np.concatenate(halves).reshape(-1, 3)).astype(np.int32)
    count = np.zeros((16, 16), int)
    for k in range(len(faces)):
        count += rasterise(AHEAD, points, faces[k : k + 1]).triangle >= 0
    uv = AHEAD.to_pixels(points)[:, :2]
    p, q, r = uv[faces[:, 0]], uv[faces[:, 1]], uv[faces[:, 2]]
    turn = (q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]
    if (turn < 0).all() or (turn > 0).all():
        assert (count == 1).all()
    else:  # random steps folded the grid over: still no crack
        assert (count >= 1).all()


def test_the_nearer_surface_wins_and_the_first_of_equals() -> None:
    near = np.array([[-1.0, -1, 2], [1, -1, 2], [-1, 1, 2]])
    far = near * [2, 2, 2]
    faces = np.array([[3, 4, 5], [0, 1, 2], [0, 1, 2]], np.int32)
    hits = rasterise(AHEAD, np.concatenate([near, far]), faces)
    assert set(np.unique(hits.triangle)) == {-1, 1}


@pytest.mark.parametrize("scale", [2, 3])
def test_supersampling_refines_the_same_image(scale: int) -> None:
    points = np.array([[-0.9, -0.8, 2], [1.1, -0.7, 2.5], [-0.6, 1.2, 3]])
    faces = np.array([[0, 1, 2]], np.int32)
    one, many = rasterise(AHEAD, points, faces), rasterise(AHEAD, points, faces, scale)
    assert many.triangle.shape == (16 * scale, 16 * scale)
    if scale == 3:  # the middle sample of nine is the pixel's centre
        np.testing.assert_array_equal(many.triangle[1::3, 1::3], one.triangle)
        seen = one.triangle >= 0
        np.testing.assert_allclose(many.depth_m[1::3, 1::3][seen], one.depth_m[seen], rtol=1e-12)
