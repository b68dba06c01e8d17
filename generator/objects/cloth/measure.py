"""What a cloth shows from straight above: how much it covers and what it hides."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from pliant.generator.compiled import compiled
from pliant.generator.objects.cloth.cells import triangles_in_cells
from pliant.spec.arrays import BoolArray, FloatArray, Int32Array

PIXELS_A_SIDE = 512
"""The silhouette is counted on a lattice of √area / 512: 0.1 % of a typical cloth."""


@dataclass(frozen=True)
class Cover:
    """A configuration seen from above.

    Attributes:
        coverage: Area of the silhouette over the flat cloth's.
        coverage_hull: Area of the silhouette's convex hull over the flat cloth's.
        self_occluded_area: Share of the material with more cloth above it.
        hidden_corners: Which of the corners (0, 0), (1, 0), (0, 1), (1, 1) have cloth above.
    """

    coverage: float
    coverage_hull: float
    self_occluded_area: float
    hidden_corners: tuple[int, ...]


def measure_cover(
    vertices: FloatArray, faces: Int32Array, corners: Int32Array, area_m2: float
) -> Cover:
    """Measure a cloth from above.

    Args:
        vertices: float64 (V, 3), metres, z up.
        faces: int32 (F, 3), triangles of equal area in the material.
        corners: int32 (4,), the corner vertices.
        area_m2: Area of the flat cloth.

    Returns:
        Its cover; the share of the material is taken at the triangles' centroids.
    """
    hidden = _hidden_faces(vertices, faces, vertices[faces].mean(axis=1))
    no_face = np.full(4, -1, dtype=np.int32)
    hidden_corners = covered_from_above(vertices, faces, vertices[corners], no_face, corners)
    return Cover(
        coverage=silhouette_m2(vertices, faces, math.sqrt(area_m2) / PIXELS_A_SIDE) / area_m2,
        coverage_hull=float(ConvexHull(vertices[:, :2]).volume) / area_m2,
        self_occluded_area=float(hidden.mean()),
        hidden_corners=tuple(int(k) for k in np.flatnonzero(hidden_corners)),
    )


def shows_underside(vertices: FloatArray, faces: Int32Array) -> bool:
    """Return whether more of a cloth's underside than of its upper side is seen from above.

    Args:
        vertices: float64 (V, 3), metres, z up.
        faces: int32 (F, 3), counter-clockwise from the upper side.
    """
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    hidden = _hidden_faces(vertices, faces, (a + b + c) / 3)
    across, along = (b - a)[:, :2], (c - a)[:, :2]
    area = across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0]  # twice, signed
    return float(area[~hidden].sum()) < 0


def _hidden_faces(vertices: FloatArray, faces: Int32Array, centroids: FloatArray) -> BoolArray:
    """Return which triangles have more of the mesh above their centroids, bool (F,)."""
    own_face = np.arange(len(faces), dtype=np.int32)
    return covered_from_above(vertices, faces, centroids, own_face, np.full_like(own_face, -1))


@compiled
def _inside(one: float, two: float, three: float) -> bool:
    """Return whether a place is on the same side of a triangle's three edges."""
    return min(one, two, three) >= 0.0 or max(one, two, three) <= 0.0


@compiled
def silhouette_m2(vertices: FloatArray, faces: Int32Array, pixel_m: float) -> float:
    """Return the area of the union of all triangles seen from above.

    Args:
        vertices: float64 (V, 3), metres.
        faces: int32 (F, 3).
        pixel_m: Spacing of the lattice whose covered points are counted.

    Returns:
        Square metres.
    """
    x_low = vertices[:, 0].min()
    y_low = vertices[:, 1].min()
    width = int((vertices[:, 0].max() - x_low) / pixel_m) + 2
    height = int((vertices[:, 1].max() - y_low) / pixel_m) + 2
    covered = np.zeros((height, width), np.uint8)
    for t in range(faces.shape[0]):
        ax = (vertices[faces[t, 0], 0] - x_low) / pixel_m
        ay = (vertices[faces[t, 0], 1] - y_low) / pixel_m
        bx = (vertices[faces[t, 1], 0] - x_low) / pixel_m
        by = (vertices[faces[t, 1], 1] - y_low) / pixel_m
        cx = (vertices[faces[t, 2], 0] - x_low) / pixel_m
        cy = (vertices[faces[t, 2], 1] - y_low) / pixel_m
        for y in range(int(np.ceil(min(ay, by, cy))), int(np.floor(max(ay, by, cy))) + 1):
            for x in range(int(np.ceil(min(ax, bx, cx))), int(np.floor(max(ax, bx, cx))) + 1):
                one = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
                two = (cx - bx) * (y - by) - (cy - by) * (x - bx)
                three = (ax - cx) * (y - cy) - (ay - cy) * (x - cx)
                if _inside(one, two, three):
                    covered[y, x] = 1
    return covered.sum() * pixel_m * pixel_m


@compiled
def covered_from_above(
    vertices: FloatArray,
    faces: Int32Array,
    points: FloatArray,
    own_face: Int32Array,
    own_vertex: Int32Array,
) -> BoolArray:
    """Say which points have a triangle above them.

    Args:
        vertices: float64 (V, 3).
        faces: int32 (F, 3).
        points: float64 (P, 3), on the mesh.
        own_face: int32 (P,), the triangle a point is in, which cannot cover it; -1 for none.
        own_vertex: int32 (P,), the vertex a point is; its triangles cannot cover it; -1 for none.

    Returns:
        bool (P,).
    """
    x_low = vertices[:, 0].min()
    y_low = vertices[:, 1].min()
    x_span = vertices[:, 0].max() - x_low
    y_span = vertices[:, 1].max() - y_low
    edge = max(np.sqrt(x_span * y_span / faces.shape[0]), 1e-9) * 2.0
    down = int(y_span / edge) + 1
    cells = np.array([int(x_span / edge) + 1, down, 1])
    low = np.array([x_low, y_low, vertices[:, 2].min()])
    start, members = triangles_in_cells(vertices, faces, low, edge, cells)
    covered = np.zeros(points.shape[0], np.bool_)
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        k = int((px - x_low) / edge) * down + int((py - y_low) / edge)
        for q in range(start[k], start[k + 1]):
            t = members[q]
            f, g, h = faces[t, 0], faces[t, 1], faces[t, 2]
            if t == own_face[i] or f == own_vertex[i] or g == own_vertex[i] or h == own_vertex[i]:
                continue
            a, b, c = vertices[f], vertices[g], vertices[h]
            one = (b[0] - a[0]) * (py - a[1]) - (b[1] - a[1]) * (px - a[0])
            two = (c[0] - b[0]) * (py - b[1]) - (c[1] - b[1]) * (px - b[0])
            three = (a[0] - c[0]) * (py - c[1]) - (a[1] - c[1]) * (px - c[0])
            double_area = one + two + three
            if not _inside(one, two, three) or double_area == 0.0:
                continue
            if (two * a[2] + three * b[2] + one * c[2]) / double_area > pz:
                covered[i] = True
                break
    return covered
