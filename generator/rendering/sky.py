"""How much of the sky a place sees: coarse depth maps from a few directions of the sky.

The sky is uniform, so what it gives changes slowly. Each of 16 directions gets a map of 96 x 96
cells into which the object's vertices are dropped; a place counts a direction as open where no
vertex is above it. The share is worked out at vertices and on a coarse grid of the table, and
interpolated between.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from pliant.generator.compiled import compiled
from pliant.spec.arrays import Float32Array, FloatArray, Int32Array

_DIRECTIONS: Final = 16
_CELLS: Final = 96


def _hemisphere(count: int) -> FloatArray:
    """Return (count, 3, 3): two axes across each direction, and the direction itself."""
    k = np.arange(count)
    up = (k + 0.5) / count
    turn = k * (math.pi * (3.0 - math.sqrt(5.0)))
    flat = np.sqrt(1.0 - up**2)
    towards = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=1)
    across = np.cross([0.0, 1.0, 0.0], towards)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([across, np.cross(towards, across), towards], axis=1)


_AXES: Final = _hemisphere(_DIRECTIONS)


class SkyMaps(NamedTuple):
    """The object's height along each direction of the sky.

    Attributes:
        height: float32 (directions, cells, cells), metres along the direction.
        centre: float64 (3,), world metres.
        cell_m: Side of a cell.
    """

    height: Float32Array
    centre: FloatArray
    cell_m: float


def sky_maps(world: FloatArray) -> SkyMaps:
    """Drop the object's vertices into the maps.

    Args:
        world: float64 (V, 3), metres.
    """
    low, high = world.min(axis=0), world.max(axis=0)
    centre = (low + high) / 2
    cell_m = float(np.linalg.norm(high - low)) / (_CELLS - 4)
    height = np.full((_DIRECTIONS, _CELLS, _CELLS), -1e9, np.float32)
    _drop(world, centre, 1.0 / cell_m, height)
    return SkyMaps(height, centre, cell_m)


@compiled
def vertex_normals(world: FloatArray, faces: Int32Array) -> FloatArray:
    """Return unit normals, weighted by area.

    Args:
        world: float64 (V, 3).
        faces: int32 (F, 3).
    """
    out = np.zeros(world.shape)
    for t in range(faces.shape[0]):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        ux = world[b, 0] - world[a, 0]
        uy = world[b, 1] - world[a, 1]
        uz = world[b, 2] - world[a, 2]
        vx = world[c, 0] - world[a, 0]
        vy = world[c, 1] - world[a, 1]
        vz = world[c, 2] - world[a, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for k in (a, b, c):
            out[k, 0] += nx
            out[k, 1] += ny
            out[k, 2] += nz
    for n in range(out.shape[0]):
        length = math.sqrt(out[n, 0] ** 2 + out[n, 1] ** 2 + out[n, 2] ** 2)
        if length > 0.0:
            for k in range(3):
                out[n, k] /= length
    return out


@compiled
def _drop(world: FloatArray, centre: FloatArray, per_m: float, height: Float32Array) -> None:
    half = 0.5 * _CELLS
    for k in range(_DIRECTIONS):
        for n in range(world.shape[0]):
            x, y, z = world[n, 0] - centre[0], world[n, 1] - centre[1], world[n, 2] - centre[2]
            i = int((_AXES[k, 0, 0] * x + _AXES[k, 0, 1] * y + _AXES[k, 0, 2] * z) * per_m + half)
            j = int((_AXES[k, 1, 0] * x + _AXES[k, 1, 1] * y + _AXES[k, 1, 2] * z) * per_m + half)
            h = np.float32(_AXES[k, 2, 0] * x + _AXES[k, 2, 1] * y + _AXES[k, 2, 2] * z)
            if h > height[k, j, i]:
                height[k, j, i] = h


@compiled
def openness(points: FloatArray, normals: FloatArray, maps: SkyMaps) -> FloatArray:
    """Return the share of the sky's light that reaches places despite the object.

    Args:
        points: float64 (N, 3), world metres.
        normals: float64 (N, 3), unit; the side that is lit.
        maps: What the sky sees of the object.

    Returns:
        float64 (N,), 0 to 1; 1 where nothing is in the way.
    """
    height, centre, cell = maps.height, maps.centre, maps.cell_m
    out = np.empty(points.shape[0])
    half = 0.5 * _CELLS
    for n in range(points.shape[0]):
        nx, ny, nz = normals[n, 0], normals[n, 1], normals[n, 2]
        x = points[n, 0] - centre[0] + 0.6 * cell * nx
        y = points[n, 1] - centre[1] + 0.6 * cell * ny
        z = points[n, 2] - centre[2] + 0.6 * cell * nz
        total = 0.0
        open_ = 0.0
        for k in range(_DIRECTIONS):
            weight = nx * _AXES[k, 2, 0] + ny * _AXES[k, 2, 1] + nz * _AXES[k, 2, 2]
            if weight <= 0.0:
                continue
            total += weight
            across = _AXES[k, 0, 0] * x + _AXES[k, 0, 1] * y + _AXES[k, 0, 2] * z
            down = _AXES[k, 1, 0] * x + _AXES[k, 1, 1] * y + _AXES[k, 1, 2] * z
            if max(abs(across), abs(down)) > half * cell:  # off the map, without a division
                open_ += weight
                continue
            u, v = across / cell + half - 0.5, down / cell + half - 0.5
            i, j = math.floor(u), math.floor(v)
            if i < 0 or j < 0 or i >= _CELLS - 1 or j >= _CELLS - 1:
                open_ += weight
                continue
            h = _AXES[k, 2, 0] * x + _AXES[k, 2, 1] * y + _AXES[k, 2, 2] * z + 0.5 * cell
            fu, fv = u - i, v - j
            seen = 0.0
            if height[k, j, i] <= h:
                seen += (1.0 - fu) * (1.0 - fv)
            if height[k, j, i + 1] <= h:
                seen += fu * (1.0 - fv)
            if height[k, j + 1, i] <= h:
                seen += (1.0 - fu) * fv
            if height[k, j + 1, i + 1] <= h:
                seen += fu * fv
            open_ += weight * seen
        out[n] = open_ / total if total > 0.0 else 1.0
    return out
