"""The sun's shadows: a depth map from the sun, and soft lookups in it.

The width of a penumbra follows from the sun's disc: a first ring of taps finds what blocks the
sun, its distance gives the width, a second disc of taps measures how much is blocked
(percentage-closer soft shadows, Fernando 2005). The taps are turned by a fixed 4 x 4 pattern over
the pixels, so that nothing is random.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter

from pliant.generator.compiled import compiled
from pliant.generator.scene.appearance import Light
from pliant.spec.arrays import Float32Array, FloatArray, Int32Array

_SIDE: Final = 1024
# Texels along the longer side of the object as the sun sees it.

_BLOCK: Final = 8
# Texels a side of a coarse cell; a coarse cell knows the nearest surface around it.

_MAX_RADIUS: Final = 14.0
# Widest penumbra, texels; less than two coarse cells, which the coarse map looks around.

_TAPS: Final = 12

_EMPTY: Final = np.float32(1e9)


def _turned_discs() -> FloatArray:
    """Return float64 (16, taps, 2): a disc turned by each angle of the pattern.

    The taps are spread evenly over the unit disc (Vogel's spiral).
    """
    k = np.arange(_TAPS)
    turn, radius = k * (math.pi * (3.0 - math.sqrt(5.0))), np.sqrt((k + 0.5) / _TAPS)
    u, v = radius * np.cos(turn), radius * np.sin(turn)
    order = np.array([0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5])
    c, s = np.cos(2 * np.pi * order / 16)[:, None], np.sin(2 * np.pi * order / 16)[:, None]
    return np.stack([c * u - s * v, s * u + c * v], axis=-1)


_DISCS: Final = _turned_discs()


class ShadowMap(NamedTuple):
    """What the sun sees of the object.

    Attributes:
        frame: float64 (3, 4); world -> map columns, map rows, metres away from the sun.
        depth: float32 (h, w), metres along the light, 1e9 where nothing is.
        coarse: float32, nearest depth in and around each block of 8 x 8 texels.
        texel_m: Side of a texel.
        spread: Penumbra radius over distance from the blocker.
    """

    frame: FloatArray
    depth: Float32Array
    coarse: Float32Array
    texel_m: float
    spread: float


def sun_axes(light: Light) -> FloatArray:
    """Return float64 (3, 3): two axes across the light, and the way it travels."""
    towards = np.asarray(light.sun_direction)
    across = np.cross([0.0, 1.0, 0.0] if abs(towards[1]) < 0.9 else [1.0, 0.0, 0.0], towards)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(towards, across), -towards])


def shadow_map(world: FloatArray, faces: Int32Array, light: Light) -> ShadowMap:
    """Draw the object as the sun sees it.

    Args:
        world: float64 (V, 3), metres.
        faces: int32 (F, 3).
        light: The sun.
    """
    axes = sun_axes(light)
    seen = world @ axes.T
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    texel = float((high - low).max()) / (_SIDE - 4)
    origin = low - 2 * texel
    columns, rows = (np.ceil((high - origin) / texel).astype(int) + 2).tolist()
    depth = np.full((rows, columns), _EMPTY, np.float32)
    seen[:, :2] = (seen[:, :2] - origin) / texel
    _draw(seen, faces, depth)
    frame = np.zeros((3, 4))
    frame[:2, :3], frame[:2, 3] = axes[:2] / texel, -origin / texel
    frame[2, :3] = axes[2]
    spread = math.tan(light.sun_angle_rad / 2)
    return ShadowMap(frame, depth, _coarse(depth), texel, spread)


@compiled
def _draw(points: FloatArray, faces: Int32Array, depth: Float32Array) -> None:
    rows, columns = depth.shape
    centres = np.arange(columns) + 0.5
    for t in range(faces.shape[0]):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        x0, y0, z0 = points[a, 0], points[a, 1], points[a, 2]
        x1, y1, z1 = points[b, 0], points[b, 1], points[b, 2]
        x2, y2, z2 = points[c, 0], points[c, 1], points[c, 2]
        i0 = max(0, math.ceil(min(x0, x1, x2) - 0.5))
        i1 = min(columns - 1, math.floor(max(x0, x1, x2) - 0.5))
        j0 = max(0, math.ceil(min(y0, y1, y2) - 0.5))
        j1 = min(rows - 1, math.floor(max(y0, y1, y2) - 0.5))
        if i0 > i1 or j0 > j1:
            continue
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if area == 0.0:
            continue
        scale = 1.0 / area
        px = centres[i0 : i1 + 1]
        for j in range(j0, j1 + 1):
            py = j + 0.5
            line = depth[j, i0 : i1 + 1]
            for k in range(i1 + 1 - i0):  # without a branch: several texels at a time
                w1 = ((px[k] - x0) * (y2 - y0) - (x2 - x0) * (py - y0)) * scale
                w2 = ((x1 - x0) * (py - y0) - (px[k] - x0) * (y1 - y0)) * scale
                w0 = 1.0 - w1 - w2
                z = np.float32(w0 * z0 + w1 * z1 + w2 * z2)
                nearer = (w0 >= 0.0) & (w1 >= 0.0) & (w2 >= 0.0) & (z < line[k])
                line[k] = z if nearer else line[k]


def _coarse(depth: Float32Array) -> Float32Array:
    down, across = (np.arange(0, side, _BLOCK) for side in depth.shape)
    nearest = np.minimum.reduceat(np.minimum.reduceat(depth, down, axis=0), across, axis=1)
    return np.asarray(minimum_filter(nearest, 5, mode="constant", cval=_EMPTY))


@compiled
def may_shade(box: FloatArray, shadow: ShadowMap) -> bool:
    """Return whether the object can take sunlight from a place in a box of the table, z = 0.

    Args:
        box: float64 (2, 2), lowest and highest x and y, world metres.
        shadow: What the sun sees.
    """
    frame, coarse = shadow.frame, shadow.coarse
    low, high = np.empty(2), np.empty(2)
    for axis in range(2):
        low[axis] = high[axis] = frame[axis, 3]
        for c in range(2):
            ends = frame[axis, c] * box[0, c], frame[axis, c] * box[1, c]
            low[axis] += min(ends)
            high[axis] += max(ends)
        # As `sunlight` does beyond the edge; a texel more than rounding can move a place.
        if low[axis] > shadow.depth.shape[1 - axis] + _MAX_RADIUS + 2.0:
            return False
        if high[axis] < -_MAX_RADIUS - 2.0:
            return False
    cells = np.empty((2, 2), np.int64)
    for axis in range(2):
        last = coarse.shape[1 - axis] - 1
        cells[axis, 0] = min(max(int(low[axis] - 1.0) // _BLOCK, 0), last)
        cells[axis, 1] = min(max(int(high[axis] + 1.0) // _BLOCK, 0), last)
    for j in range(cells[1, 0], cells[1, 1] + 1):
        for i in range(cells[0, 0], cells[0, 1] + 1):
            if coarse[j, i] < _EMPTY:
                return True
    return False


@compiled
def _clear_around(sx: float, sy: float, away: float, depth: Float32Array) -> bool:
    """Return whether no texel within one of a place, so no tap of that radius, blocks the sun."""
    rows, columns = depth.shape
    i, j = math.floor(sx), math.floor(sy)
    if i < 1 or j < 1 or i >= columns - 1 or j >= rows - 1:
        return False
    nearest = depth[j, i]
    for dj in range(-1, 2):
        for di in range(-1, 2):
            nearest = min(nearest, depth[j + dj, i + di])
    return nearest >= away


@compiled
def sunlight(
    x: float,
    y: float,
    z: float,
    column: int,
    row: int,
    frame: FloatArray,
    depth: Float32Array,
    coarse: Float32Array,
    texel_m: float,
    spread: float,
) -> float:
    """Return the share of the sun's disc that a place sees.

    Args:
        x: Place, world metres, moved off its surface by two texels.
        y: Place.
        z: Place.
        column: Pixel; it turns the taps.
        row: Pixel.
        frame: `ShadowMap.frame`.
        depth: `ShadowMap.depth`.
        coarse: `ShadowMap.coarse`.
        texel_m: `ShadowMap.texel_m`.
        spread: `ShadowMap.spread`.
    """
    rows, columns = depth.shape
    sx = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z + frame[0, 3]
    sy = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z + frame[1, 3]
    # Beyond the map's edge the penumbra goes on: look up the nearest coarse cell.
    reach = _MAX_RADIUS + 1.0
    if sx < -reach or sy < -reach or sx >= columns + reach or sy >= rows + reach:
        return 1.0
    away = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z - 0.5 * texel_m
    ci = min(max(int(sx) // _BLOCK, 0), coarse.shape[1] - 1)
    cj = min(max(int(sy) // _BLOCK, 0), coarse.shape[0] - 1)
    nearest = coarse[cj, ci]
    if nearest >= away:
        return 1.0
    turn = (row & 3) * 4 + (column & 3)
    search = min(max(spread * (away - nearest) / texel_m, 1.0), _MAX_RADIUS)
    if search == 1.0 and _clear_around(sx, sy, away, depth):
        return 1.0
    blockers = 0
    total = 0.0
    for k in range(_TAPS):
        i = math.floor(sx + search * _DISCS[turn, k, 0])
        j = math.floor(sy + search * _DISCS[turn, k, 1])
        if 0 <= i < columns and 0 <= j < rows and depth[j, i] < away:
            blockers += 1
            total += depth[j, i]
    if blockers == 0:
        return 1.0
    radius = min(max(spread * (away - total / blockers) / texel_m, 0.9), _MAX_RADIUS)
    if radius > 0.9 * search:
        return 1.0 - blockers / _TAPS
    lit = 0
    for k in range(_TAPS):
        i = math.floor(sx + radius * _DISCS[turn, k, 0])
        j = math.floor(sy + radius * _DISCS[turn, k, 1])
        if not (0 <= i < columns and 0 <= j < rows and depth[j, i] < away):
            lit += 1
    return lit / _TAPS
