"""Intersections, subdivision and cover, on shapes whose answers are known."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial import cKDTree

from pliant.generator.objects.cloth.grid import (
    corner_vertices,
    flat_positions,
    grid_mesh,
    triangle_edges,
)
from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.generator.objects.cloth.intersections import find_intersections
from pliant.generator.objects.cloth.measure import measure_cover
from pliant.generator.objects.cloth.surface import Placement, _four_point, subdivide
from pliant.spec.arrays import FloatArray

_CHUNK = 200_000


def count_intersections(vertices: FloatArray, faces: npt.NDArray[np.int32]) -> int:
    """Return how many (edge, triangle) pairs without a common vertex cross, counted another way.

    The package walks a grid of cells and decides by signs of volumes. Here candidates come from
    a k-d tree and each is decided by Möller and Trumbore's ray against the triangle; numpy and
    scipy alone, nothing of the package.

    Args:
        vertices: float64 (V, 3).
        faces: int32 (F, 3).
    """
    edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    ends = vertices[edges]
    corners = vertices[faces]
    centroids = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centroids[:, None], axis=2).max()
    middles = ends.mean(axis=1)
    half = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
    tree = cKDTree(centroids)
    total = 0
    for first in range(0, len(edges), 20_000):
        block = slice(first, first + 20_000)
        near = tree.query_ball_point(middles[block], half[block] + reach)
        sizes = np.array([len(n) for n in near])
        edge = np.repeat(np.arange(first, first + len(sizes)), sizes)
        face = np.concatenate([np.asarray(n, dtype=np.int64) for n in near])
        apart = ~(edges[edge][:, :, None] == faces[face][:, None, :]).any(axis=(1, 2))
        edge, face = edge[apart], face[apart]
        for start in range(0, len(edge), _CHUNK):
            chunk = slice(start, start + _CHUNK)
            total += int(_crosses(ends[edge[chunk]], corners[face[chunk]]).sum())
    return total


def _crosses(segment: FloatArray, triangle: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether each segment (N, 2, 3) crosses its triangle (N, 3, 3)."""
    origin, direction = segment[:, 0], segment[:, 1] - segment[:, 0]
    one = triangle[:, 1] - triangle[:, 0]
    two = triangle[:, 2] - triangle[:, 0]
    p = np.cross(direction, two)
    determinant = (one * p).sum(axis=1)
    lengths = np.linalg.norm(direction, axis=1) * np.linalg.norm(np.cross(one, two), axis=1)
    skew = np.abs(determinant) > 1e-12 * lengths  # else the segment lies along the plane
    inverse = 1.0 / np.where(skew, determinant, 1.0)
    t = origin - triangle[:, 0]
    u = (t * p).sum(axis=1) * inverse
    q = np.cross(t, one)
    v = (direction * q).sum(axis=1) * inverse
    s = (two * q).sum(axis=1) * inverse
    return skew & (u > 0) & (v > 0) & (u + v < 1) & (s > 0) & (s < 1)


def count(vertices: np.ndarray, faces: np.ndarray) -> int:
    faces = np.asarray(faces, dtype=np.int32)
    return len(find_intersections(np.asarray(vertices, float), faces, triangle_edges(faces)))


TRIANGLE = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]


@pytest.mark.parametrize(
    ("other", "crossings"),
    [
        ([[1, 1, -1], [1, 1, 1], [9, -9, 5]], 2),  # one edge goes in, one of the other's goes out
        ([[1, 1, -1], [1, 1, 1], [1.2, 1, 1]], 2),  # two of its edges do
        ([[1, 1, 0.1], [1, 1, 1], [2, 1, 1]], 0),  # above
        ([[5, 5, -1], [5, 5, 1], [6, 5, 1]], 0),  # beside
        ([[1, 1, 0], [2, 1, 0], [1, 2, 0]], 0),  # in the same plane
        ([[1, 1, 0], [1, 1, 1], [2, 1, 1]], 0),  # touches with a corner
    ],
)
def test_two_triangles_by_hand(other: list[list[float]], crossings: int) -> None:
    vertices = np.array(TRIANGLE + other, dtype=float)
    assert count(vertices, np.array([[0, 1, 2], [3, 4, 5]])) == crossings


def test_edges_at_a_common_vertex_are_not_counted() -> None:
    vertices = np.array([*TRIANGLE, [1, 1, -1], [1, 1, 1]], dtype=float)
    assert count(vertices, np.array([[0, 1, 2], [3, 4, 0]])) == 1


def test_a_soup_of_triangles_agrees_with_the_independent_count() -> None:
    rng = np.random.default_rng(0)
    centres = rng.uniform(0, 1, (300, 1, 3))
    vertices = (centres + rng.normal(0, 0.06, (300, 3, 3))).reshape(-1, 3)
    faces = np.arange(900, dtype=np.int32).reshape(-1, 3)
    found = count(vertices, faces)
    assert found > 50
    assert found == count_intersections(vertices, faces)


def test_more_hits_than_expected_are_all_returned() -> None:
    # A comb of 60 long triangles through 60 others: more than the first buffer holds.
    teeth = np.linspace(0.1, 0.9, 60)
    flat = [[[0, y, 0], [1, y, 0], [0.5, y, 1.5]] for y in teeth]
    upright = [[[x, 0, 0.01], [x, 1, 0.01], [x, 0.5, 0.3]] for x in teeth]
    vertices = np.array(flat + upright, dtype=float).reshape(-1, 3)
    faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    found = count(vertices, faces)
    assert found > 1024
    assert found == count_intersections(vertices, faces)


FOLDED = GridShape(13, 17)


def sheet_over_itself(gap: float) -> np.ndarray:
    """A sheet of 13 x 17 that is folded over a round edge, its halves `gap` apart."""
    positions = flat_positions(FOLDED, 1.6)
    x = positions[:, 0].copy()
    half = (1.6 - np.pi * gap / 2) / 2
    turned = np.clip((x - half) / (gap / 2), 0, np.pi)
    positions[:, 0] = np.where(x < half, x, half + gap / 2 * np.sin(turned))
    past = x > half + np.pi * gap / 2
    positions[past, 0] = half - (x[past] - half - np.pi * gap / 2)
    positions[:, 2] = 0.1 + gap / 2 * (1 - np.cos(turned))
    return positions


def test_cover_of_a_flat_and_of_a_folded_sheet() -> None:
    grid = GridShape(21, 41)  # 0.5 m x 0.25 m
    faces, _ = grid_mesh(grid)
    flat = flat_positions(grid, 0.5)
    corners = corner_vertices(grid)
    cover = measure_cover(flat, faces, corners, 0.125)
    assert cover.coverage == pytest.approx(1.0, abs=0.005)
    assert cover.coverage_hull == pytest.approx(1.0)
    assert cover.self_occluded_area == 0.0
    assert cover.hidden_corners == ()
    # Fold u > 0.6 back over the rest: 0.4 of the width lies double, the upper layer on top.
    folded = flat.copy()
    over = folded[:, 0] > 0.3
    folded[over, 0] = 0.6 - folded[over, 0]
    folded[over, 2] = 0.01
    cover = measure_cover(folded, faces, corners, 0.125)
    assert cover.coverage == pytest.approx(0.6, abs=0.005)
    assert cover.coverage_hull == pytest.approx(0.6, abs=1e-9)
    assert cover.self_occluded_area == pytest.approx(0.4, abs=0.03)  # a column of cells stands
    assert cover.hidden_corners == ()
    # Folded under instead, it is the folded corners that cannot be seen.
    folded[over, 2] = -0.01
    cover = measure_cover(folded, faces, corners, 0.125)
    assert cover.hidden_corners == (1, 3)


def test_the_masses_stand_in_the_finer_grid() -> None:
    rng, grid = np.random.default_rng(4), GridShape(5, 7)
    masses = flat_positions(grid, 0.6) + rng.normal(0, 0.01, (35, 3)) + [0.0, 0.0, 1.0]
    fine, pierced = subdivide(masses, grid, 2, 0.0)
    assert fine.shape == (17 * 25, 3)
    assert pierced == 0
    np.testing.assert_array_equal(fine.reshape(17, 25, 3)[::4, ::4], masses.reshape(5, 7, 3))


def test_a_cubic_surface_is_reproduced_inside() -> None:
    grid = GridShape(7, 9)
    flat = flat_positions(grid, 0.8)
    x, y = flat[:, 0], flat[:, 1]
    masses = np.stack([x, y, 1 + x**3 - 2 * x * y**2 + y**3], axis=1)
    fine, _ = subdivide(masses, grid, 1, 0.0)
    inner = fine.reshape(13, 17, 3)[2:-2, 2:-2].reshape(-1, 3)
    x, y = inner[:, 0], inner[:, 1]
    np.testing.assert_allclose(inner[:, 2], 1 + x**3 - 2 * x * y**2 + y**3, atol=1e-12)


def test_smoothing_takes_out_the_dimples_and_leaves_a_plane() -> None:
    grid = GridShape(7, 9)
    plane = flat_positions(grid, 0.8)
    plane[:, 2] = 1 + 0.3 * plane[:, 0] - 0.2 * plane[:, 1]
    smooth, _ = subdivide(plane, grid, 0, 0.0, smoothing=1.0)
    np.testing.assert_allclose(smooth, plane, atol=1e-12)
    row, column = np.divmod(np.arange(63), 9)
    for dimple in (row % 2, column % 2, (row + column) % 2):
        dented = plane + 0.01 * np.stack([0 * dimple, 0 * dimple, dimple], axis=1)
        smooth, _ = subdivide(dented, grid, 0, 0.0, smoothing=1.0)
        inner = (smooth - plane)[:, 2].reshape(7, 9)[1:-1, 1:-1]
        assert np.ptp(inner) < 1e-12


def test_nothing_is_left_under_the_table() -> None:
    grid = GridShape(5, 5)
    masses = flat_positions(grid, 0.4)
    masses[12, 2] = 0.1
    fine, _ = subdivide(masses, grid, 2, 0.02)
    assert fine[:, 2].min() == 0.02


def test_a_surface_that_would_pierce_itself_is_drawn_back() -> None:
    # A sharp crease presses the smooth surface through a layer that the triangles clear.
    rng = np.random.default_rng(8)
    faces, edges = grid_mesh(FOLDED)
    fine_faces, fine_edges = grid_mesh(GridShape(25, 33))
    drawn_back = 0
    for _ in range(120):
        masses = sheet_over_itself(rng.uniform(0.04, 0.15))
        masses += rng.normal(0, 0.02, masses.shape)
        raw = len(find_intersections(masses, faces, edges))
        fine, pierced = subdivide(masses, FOLDED, 1, -1.0)
        assert len(find_intersections(fine, fine_faces, fine_edges)) == pierced
        assert raw > 0 or pierced == 0
        smooth = _four_point(_four_point(masses.reshape(*FOLDED, 3), 0), 1).reshape(-1, 3)
        drawn_back += raw == 0 and len(find_intersections(smooth, fine_faces, fine_edges)) > 0
    assert drawn_back > 3


def test_placement_turns_and_centres() -> None:
    positions = np.array([[0, 0, 1], [2, 0, 1], [2, 1, 3]], dtype=float)
    placed = Placement.centred(positions, np.pi / 2).apply(positions)
    np.testing.assert_allclose(placed, [[0.5, -1, 1], [0.5, 1, 1], [-0.5, 1, 3]], atol=1e-15)
