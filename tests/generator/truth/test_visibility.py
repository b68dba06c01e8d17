"""What hides a point, on triangles written out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.generator.scene.camera import NEAR_M
from pliant.generator.truth.visibility import first_occluders, inside_frame
from pliant.spec.camera import Camera

# Looks along +z from the origin: K maps (x, y, z) to (8 x / z + 8, 8 y / z + 8), 16 x 12 px.
AHEAD = Camera(np.array([[8.0, 0, 8], [0, 8.0, 8], [0, 0, 1]]), np.eye(4), (16, 12))


def test_the_frame_has_its_first_edges_and_not_its_last() -> None:
    inside = [(0, 0, 1), (15.999, 11.999, 1), (8, 6, NEAR_M), (-1e-46, 6, 1), (8, -1e-46, 1)]
    outside = [(-0.001, 6, 1), (16, 6, 1), (8, -0.001, 1), (8, 12, 1), (8, 6, NEAR_M * 0.999)]
    outside += [(15.9999999, 6, 1), (8, 11.9999999, 1)]  # float32 rounds them up
    found = inside_frame(AHEAD, np.array([*inside, *outside]))
    assert found.tolist() == [True] * len(inside) + [False] * len(outside)


@pytest.mark.parametrize(
    ("own", "triangle"),
    [
        ((-1, -1), 1),
        ((0, 0), -1),  # a vertex: no triangle around it can hide it
        ((0, 1), 1),  # an edge: a triangle at one of its ends can
        ((1, 0), 1),
        ((3, 4), -1),
    ],
)
def test_a_flap_hides_what_is_not_its_own(own: tuple[int, int], triangle: int) -> None:
    # A triangle at depth 2; a flap from its vertex 0 folds over the point (0, 0, 2).
    mesh = np.array([[-1.0, 0, 2], [1, 0, 2], [0, 1, 2], [1, -2, 1], [1, 1, 1], [9, 9, 1]])
    faces = np.array([[0, 1, 2], [0, 3, 4]], np.int32)
    # Before and after: behind the camera, out of sight, and seen edge-on.
    behind, beside, edge_on = mesh * [1, 1, -1], mesh + np.array([50, 0, 0]), mesh * [0, 1, 1]
    vertices = np.concatenate([mesh, behind, beside, edge_on])
    others = np.concatenate([faces + np.int32(6 * k) for k in (1, 2, 3)])
    point = np.array([[0.0, 0, 2]])
    camera_and_own = AHEAD, point, np.array([own], np.int32)
    after = first_occluders(*camera_and_own, vertices, np.concatenate([faces, others]))
    before = first_occluders(*camera_and_own, vertices, np.concatenate([others, faces]))
    assert after[0].tolist() == [triangle]
    assert before[0].tolist() == [triangle + len(others) if triangle >= 0 else -1]
    if triangle >= 0:
        # The flap's plane is z = 1.5 - x / 2 and is met at (0, 0, 1.5), half of the way from vertex
        # 0 to (1, 0, 1), which is at two thirds between the vertices 3 and 4.
        np.testing.assert_allclose(after[1], [[1 / 6, 1 / 3]], atol=1e-12)
        np.testing.assert_array_equal(before[1], after[1])


def test_every_point_of_the_image_is_looked_for() -> None:
    """A sheet before all of them hides points in every corner of the image."""
    sheet = np.array([[-9.0, -9, 1], [9, -9, 1], [9, 9, 1], [-9, 9, 1]])
    u, v = np.meshgrid([-1e-46, 0.5, 7.9, 8.0, 15.99], [-1e-46, 0.5, 4, 11.99])
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    points = np.column_stack([(uv - 8) / 8, np.ones(len(uv))]) * 2.0
    own = np.full((len(uv), 2), -1, np.int32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    triangle, weights = first_occluders(AHEAD, points, own, sheet, faces)
    assert (triangle >= 0).all()
    at = sheet[faces[triangle]]
    found = at[:, 0] + (weights[..., None] * (at[:, 1:] - at[:, :1])).sum(axis=1)
    np.testing.assert_allclose(found, points / 2, atol=1e-12)
