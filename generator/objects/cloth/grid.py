"""The square grid of a cloth: its triangles, its edges and its symmetric vertices.

Vertices are numbered row by row: vertex `row * side + column`. A column is a step of u and a row
a step of v.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from pliant.generator.scene.scene_object import IntArray, quads
from pliant.spec.arrays import FloatArray


def grid_faces(side: int) -> IntArray:
    """Return the two triangles of every cell, wound so that a flat sheet faces up.

    Args:
        side: Vertices along a side, >= 2.

    Returns:
        int32 (2 * (side - 1)**2, 3), vertex indices.
    """
    row, column = np.meshgrid(np.arange(side - 1), np.arange(side - 1), indexing="ij")
    corner = (row * side + column).ravel()
    return quads(corner, corner + 1, corner + side + 1, corner + side)


@lru_cache(maxsize=8)
def grid_mesh(side: int) -> tuple[IntArray, IntArray]:
    """Return the triangles of a grid and their edges; shared, so read-only."""
    faces = grid_faces(side)
    edges = triangle_edges(faces)
    faces.setflags(write=False)
    edges.setflags(write=False)
    return faces, edges


def triangle_edges(faces: IntArray) -> IntArray:
    """Return every edge of a triangle mesh once: int32 (E, 2), ascending."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges: IntArray = np.unique(np.sort(sides, axis=1), axis=0).astype(np.int32)
    return edges


def flat_positions(side: int, side_m: float) -> FloatArray:
    """Return a flat sheet in the plane z = 0 with its first vertex at the origin.

    Args:
        side: Vertices along a side.
        side_m: Length of a side, metres.

    Returns:
        float64 (side * side, 3), metres.
    """
    along = np.linspace(0.0, side_m, side)
    y, x = np.meshgrid(along, along, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def corner_vertices(side: int) -> IntArray:
    """Return the corners at (u, v) = (0, 0), (1, 0), (0, 1) and (1, 1): int32 (4,)."""
    last = (side - 1) * side
    return np.array([0, side - 1, last, last + side - 1], dtype=np.int32)


def mapped_vertices(side: int, matrix: npt.ArrayLike, offset: npt.ArrayLike) -> IntArray:
    """Return the vertex that a symmetry of the square sends each vertex to.

    The map acts on integers (steps of the grid), so that partners are exact.

    Args:
        side: Vertices a side of the square grid.
        matrix: (2, 2) with entries -1, 0 or 1: m' = matrix · m + offset, m = (u, v).
        offset: (2,) with entries 0 or 1.

    Returns:
        int32 (side * side,), a permutation of the vertices.
    """
    row, column = np.divmod(np.arange(side * side), side)
    steps = np.stack([column, row])
    images = np.asarray(matrix, dtype=np.int64) @ steps
    images += np.asarray(offset, dtype=np.int64)[:, None] * (side - 1)
    return (images[1] * side + images[0]).astype(np.int32)
