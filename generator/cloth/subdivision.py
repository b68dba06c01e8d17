"""From the simulated grid to the rendered one: smooth, through the same masses, never crossing.

A cloth drawn on the grid of its simulation shows facets. The four-point scheme (Dyn, Levin,
Gregory 1987) puts a smooth surface through the masses: a new vertex is
(9 (p1 + p2) - (p0 + p3)) / 16. Where two layers nearly touch, the smooth surface could pierce
itself; there, and only there, it is drawn towards the flat triangles of the simulated mesh.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pliant.generator.cloth.grid import grid_faces
from pliant.generator.cloth.intersections import find_intersections

FloatArray = npt.NDArray[np.float64]

_TRIES = 6


def subdivide(
    positions: FloatArray, columns: int, rows: int, doublings: int, floor_m: float
) -> FloatArray:
    """Refine a grid of masses for rendering.

    Args:
        positions: float64 (rows * columns, 3), metres.
        columns: Masses in a row.
        rows: Masses in a column.
        doublings: How often the cells are halved; 0 returns the masses.
        floor_m: No vertex is left below this height, metres.

    Returns:
        float64 (((rows - 1) * 2**doublings + 1) * ((columns - 1) * 2**doublings + 1), 3). The
        masses stand in it unmoved (but for the floor), every 2**doublings-th vertex.
    """
    grid = positions.reshape(rows, columns, 3).copy()
    np.maximum(grid[..., 2], floor_m, out=grid[..., 2])
    for _ in range(doublings):
        grid = _double(grid, floor_m)
    return np.ascontiguousarray(grid.reshape(-1, 3))


def _double(grid: FloatArray, floor_m: float) -> FloatArray:
    smooth = _four_point(_four_point(grid, 0), 1)
    np.maximum(smooth[..., 2], floor_m, out=smooth[..., 2])
    flat = _on_triangles(grid)
    rows, columns = smooth.shape[:2]
    faces = grid_faces(columns, rows)
    tension = np.zeros((rows, columns, 1))
    fine = smooth
    for attempt in range(_TRIES):
        pierced = find_intersections(fine.reshape(-1, 3), faces)
        if len(pierced) == 0:
            break
        touched = np.zeros((rows, columns), dtype=bool)
        touched.flat[pierced.ravel()] = True
        tension[_grown(touched)] += 0.5
        if attempt == _TRIES - 2:
            tension[:] = 1.0
        np.minimum(tension, 1.0, out=tension)
        fine = smooth + tension * (flat - smooth)
    return fine


def _four_point(grid: FloatArray, axis: int) -> FloatArray:
    """Halve the cells along one axis; past an edge, the sheet goes on straight."""
    g = np.moveaxis(grid, axis, 0)
    before = 2.0 * g[:1] - g[1:2]
    after = 2.0 * g[-1:] - g[-2:-1]
    padded = np.concatenate([before, g, after])
    middle = (9.0 * (padded[1:-2] + padded[2:-1]) - (padded[:-3] + padded[3:])) / 16.0
    out = np.empty((2 * len(g) - 1, *g.shape[1:]))
    out[::2] = g
    out[1::2] = middle
    return np.moveaxis(out, 0, axis)


def _on_triangles(grid: FloatArray) -> FloatArray:
    """Halve the cells on the surface of `grid_faces`' own triangles."""
    rows, columns = grid.shape[:2]
    out = np.empty((2 * rows - 1, 2 * columns - 1, 3))
    out[::2, ::2] = grid
    out[::2, 1::2] = 0.5 * (grid[:, :-1] + grid[:, 1:])
    out[1::2, ::2] = 0.5 * (grid[:-1] + grid[1:])
    out[1::2, 1::2] = 0.5 * (grid[:-1, :-1] + grid[1:, 1:])
    return out


def _grown(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return a mask grown by two vertices in every direction."""
    padded = np.pad(mask, 2)
    rows, columns = mask.shape
    grown = np.zeros_like(mask)
    for row in range(5):
        for column in range(5):
            grown |= padded[row : row + rows, column : column + columns]
    return grown
