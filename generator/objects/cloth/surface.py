"""From the masses of a simulation to the rendered surface: smooth, and never crossing itself.

Two layers that touch are held apart mass by mass, and the masses of the upper one sink between
those of the lower: the sheet gets the dimples of a grid, which no cloth has. One average over
neighbours, weights 1 2 1, takes them out. The four-point scheme (Dyn, Levin, Gregory 1987)
then puts a smooth surface through the masses: a new vertex is (9 (p1 + p2) - (p0 + p3)) / 16.
Where either would make the surface pierce itself, there and only there, it is drawn back: the
first towards the masses as simulated, the second towards the flat triangles between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation

from pliant.generator import portable
from pliant.generator.objects.cloth.grid import corner_vertices, grid_mesh
from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.generator.objects.cloth.intersections import find_intersections
from pliant.generator.objects.cloth.measure import Cover, measure_cover
from pliant.generator.settings.cloth import ClothSettings
from pliant.spec.arrays import FloatArray, Int32Array

PART = "cloth"

_TRIES = 6


@dataclass(frozen=True)
class Placement:
    """Where a simulated cloth is in the world: turned about the vertical, then shifted.

    Attributes:
        yaw_rad: Angle of the turn.
        shift_m: (x, y), added after the turn.
    """

    yaw_rad: float
    shift_m: tuple[float, float]

    @classmethod
    def centred(cls, positions: FloatArray, yaw_rad: float) -> Placement:
        """Return the placement that puts the middle of the cloth's box over the origin."""
        turned = cls(yaw_rad, (0.0, 0.0)).apply(positions)
        middle = 0.5 * (turned.min(axis=0) + turned.max(axis=0))
        return cls(yaw_rad, (-float(middle[0]), -float(middle[1])))

    def apply(self, positions: FloatArray) -> FloatArray:
        """Return positions (float64 (N, 3), metres) in the world."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        placed = portable.product(positions, np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
        placed[:, :2] += self.shift_m
        return placed


def render_vertices(settings: ClothSettings, positions: FloatArray) -> tuple[FloatArray, int]:
    """Return the rendered grid through the masses, and how often it pokes through itself.

    Args:
        settings: The tier's settings.
        positions: float64 (N, 3), the masses of `settings.grid` in the world, metres.

    Returns:
        float64 (V, 3), the vertices of `settings.render_grid`, metres, and the number of edges that
        pierce a triangle.
    """
    floor_m = 0.5 * settings.thickness_m
    return subdivide(positions, settings.grid, settings.doublings, floor_m, settings.smoothing)


def cover_of(settings: ClothSettings, vertices: FloatArray) -> Cover:
    """Return what the rendered surface shows from above."""
    grid = settings.render_grid
    return measure_cover(vertices, grid_mesh(grid)[0], corner_vertices(grid), settings.area_m2)


def subdivide(
    positions: FloatArray, masses: GridShape, doublings: int, floor_m: float, smoothing: float = 0.0
) -> tuple[FloatArray, int]:
    """Refine a grid of masses for rendering.

    Args:
        positions: float64 (rows * columns, 3), metres.
        masses: The grid of the masses.
        doublings: How often the cells are halved.
        floor_m: No vertex is left below this height, metres.
        smoothing: How far every mass first goes towards the average over its neighbours, 0 to
            1. At 0 the masses stand unmoved in the result (but for the floor), every
            2**doublings-th vertex in a row and a column.

    Returns:
        The vertices, float64 (V, 3), of a grid whose cells are 2**doublings times smaller; and the
        number of edges that pierce a triangle of them: 0 unless the simulated mesh pokes through
        itself.
    """
    grid = _above(positions.reshape(*masses, 3), floor_m)
    pierced = 0
    if smoothing > 0.0 or doublings == 0:
        smooth = grid + smoothing * (_averaged(grid) - grid)
        grid, pierced = _unpierced(_above(smooth, floor_m), grid)
    for _ in range(doublings):
        smooth = _four_point(_four_point(grid, 0), 1)
        grid, pierced = _unpierced(_above(smooth, floor_m), _on_triangles(grid))
    return np.ascontiguousarray(grid.reshape(-1, 3)), pierced


def _unpierced(wanted: FloatArray, safe: FloatArray) -> tuple[FloatArray, int]:
    """Return the wanted surface, drawn to the safe one where it pierces itself."""
    share = np.zeros((*wanted.shape[:2], 1))  # of the safe surface
    grid = wanted
    pierced = _pierced(grid)
    for attempt in range(_TRIES):
        if len(pierced) == 0:
            break
        touched = np.zeros(wanted.shape[:2], dtype=bool)
        touched.flat[pierced.ravel()] = True
        share[binary_dilation(touched, np.ones((5, 5)))] += 0.5  # two vertices around
        if attempt == _TRIES - 1:
            share[:] = 1.0
        np.minimum(share, 1.0, out=share)
        grid = wanted + share * (safe - wanted)
        pierced = _pierced(grid)
    return grid, len(pierced)


def _pierced(grid: FloatArray) -> Int32Array:
    return find_intersections(grid.reshape(-1, 3), *grid_mesh(GridShape(*grid.shape[:2])))


def _above(grid: FloatArray, floor_m: float) -> FloatArray:
    raised = grid.copy()
    np.maximum(raised[..., 2], floor_m, out=raised[..., 2])
    return raised


def _averaged(grid: FloatArray) -> FloatArray:
    """Average over 3 x 3 vertices, weights (1 2 1) / 4 either way, straight on past an edge."""
    around = np.pad(grid, ((1, 1), (1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    rows = 0.25 * (around[:-2] + around[2:]) + 0.5 * around[1:-1]
    return np.asarray(0.25 * (rows[:, :-2] + rows[:, 2:]) + 0.5 * rows[:, 1:-1])


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
