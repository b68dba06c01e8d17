"""The grid of a cloth: its triangles, its edges and its symmetric vertices.

Vertices are numbered row by row: vertex `row * columns + column`. A column is a step of u and a row
a step of v.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.generator.scene.scene_object import quads
from pliant.spec.arrays import FloatArray, Int32Array


def grid_faces(grid: GridShape) -> Int32Array:
    """Return the two triangles of every cell, wound so that a flat sheet faces up.

    Args:
        grid: The vertices.

    Returns:
        int32 (2 * (rows - 1) * (columns - 1), 3), vertex indices.
    """
    rows, columns = grid
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    corner = (row * columns + column).ravel()
    return quads(corner, corner + 1, corner + columns + 1, corner + columns)


@lru_cache(maxsize=8)
def grid_mesh(grid: GridShape) -> tuple[Int32Array, Int32Array]:
    """Return the triangles of a grid and their edges; shared, so read-only."""
    faces = grid_faces(grid)
    edges = triangle_edges(faces)
    faces.setflags(write=False)
    edges.setflags(write=False)
    return faces, edges


def triangle_edges(faces: Int32Array) -> Int32Array:
    """Return every edge of a triangle mesh once: int32 (E, 2), ascending."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.asarray(np.unique(np.sort(sides, axis=1), axis=0).astype(np.int32))


def flat_positions(grid: GridShape, side_m: float) -> FloatArray:
    """Return a flat sheet in the plane z = 0 with its first vertex at the origin.

    Args:
        grid: Rows and columns of vertices. u grows along x from column to column, v along y from
            row to row.
        side_m: Length along x, metres; the spacing along y is the same.

    Returns:
        float64 (rows * columns, 3), metres.
    """
    along_v = np.linspace(0.0, side_m * grid.proportion, grid.rows)
    along_u = np.linspace(0.0, side_m, grid.columns)
    y, x = np.meshgrid(along_v, along_u, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def corner_vertices(grid: GridShape) -> Int32Array:
    """Return the corners at (u, v) = (0, 0), (1, 0), (0, 1) and (1, 1): int32 (4,)."""
    rows, columns = grid
    last = (rows - 1) * columns
    return np.array([0, columns - 1, last, last + columns - 1], dtype=np.int32)


def mapped_vertices(grid: GridShape, matrix: npt.ArrayLike, offset: npt.ArrayLike) -> Int32Array:
    """Return the vertex that a symmetry of the sheet sends each vertex to.

    The map acts on integers (steps of the grid), so that partners are exact.

    Args:
        grid: The vertices.
        matrix: (2, 2) with entries -1, 0 or 1: m' = matrix · m + offset, m = (u, v). Only in a
            square grid may it exchange u and v.
        offset: (2,) with entries 0 or 1.

    Returns:
        int32 (rows * columns,), a permutation of the vertices.
    """
    rows, columns = grid
    row, column = np.divmod(np.arange(grid.vertices), columns)
    steps = np.stack([column, row])
    images = np.asarray(matrix, dtype=np.int64) @ steps
    images += (np.asarray(offset, dtype=np.int64) * [columns - 1, rows - 1])[:, None]
    return (images[1] * columns + images[0]).astype(np.int32)
