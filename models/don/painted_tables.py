"""Draws tables with a pattern: cells, tiles, planks, crossing bands, and scattered things.

Tables of the generator are plain, mottled or of wood. A network that finds masks and has seen no
others takes joints of tiles, printed lines and bright spots for the object. What is drawn here
looks like no real table, but has edges of all sizes, directions and contrasts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import cv2
import numpy as np
from scipy import ndimage

from pliant.spec.arrays import Float32Array

Pattern = Callable[[tuple[int, int], np.random.Generator], Float32Array]
"""Draws a table of a shape (height, width), float32 (height, width, 3), about 0 to 1."""

_FINER: Final = 2  # drawn so many times as large, so that edges are smooth
_LITTERED: Final = 0.25  # of the tables with another pattern also have things on them
_COLOURLESS: Final = 0.4
_GRAIN: Final = 0.06


def painted_table(height: int, width: int, rng: np.random.Generator) -> Float32Array:
    """Return a picture of a table, float32 (height, width, 3), 0 to 1."""
    shape = (_FINER * height, _FINER * width)
    drawn = rng.integers(len(_PATTERNS))
    table = _PATTERNS[drawn](shape, rng)
    if _PATTERNS[drawn] is not _litter and rng.random() < _LITTERED:
        table = _scattered(table, rng)
    smooth = cv2.resize(table, (width, height), interpolation=cv2.INTER_AREA)
    grain = _GRAIN * rng.random() ** 2 * rng.standard_normal((height, width, 1))
    return np.asarray((smooth + grain).clip(0, 1), dtype=np.float32)


def _colours(count: int, rng: np.random.Generator) -> Float32Array:
    """Return colours (count, 3) about a common one: alike or far apart, grey or not."""
    light, tint = rng.random(), rng.random() * rng.uniform(-0.5, 0.5, 3)
    own = rng.standard_normal((count, 1 if rng.random() < _COLOURLESS else 3))
    return (light + tint + 0.4 * rng.random() * own).clip(0, 1).astype(np.float32)


def _cells(shape: tuple[int, int], rng: np.random.Generator) -> Float32Array:
    """Return a Voronoi diagram: a mosaic with joints, or gravel that is darker between stones."""
    count = int(np.exp(rng.uniform(np.log(10), np.log(4000))))
    seeds = np.ones(shape, np.uint8)
    seeds[rng.integers(0, shape[0], count), rng.integers(0, shape[1], count)] = 0
    _, cell = cv2.distanceTransformWithLabels(seeds, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    colours = _colours(8, rng)[rng.integers(0, 8, count + 1)]
    table = colours[cell] * rng.uniform(0.8, 1.2, count + 1).astype(np.float32)[cell][..., None]
    inner = ndimage.minimum_filter(cell, 3) == ndimage.maximum_filter(cell, 3)
    inside_px = cv2.distanceTransform(inner.astype(np.uint8), cv2.DIST_L2, 3)
    if rng.random() < 0.5:
        return table * (0.3 + inside_px / (inside_px.mean() + 1)).clip(0, 1.1)[..., None]
    joint_px = 8 * rng.random() ** 2
    table[inside_px < joint_px] = _colours(1, rng)[0]
    return np.asarray(table)


def _turned(shape: tuple[int, int], rng: np.random.Generator) -> tuple[Float32Array, Float32Array]:
    """Return coordinates along two directions of a table, at about a right angle, px."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    way = rng.uniform(0, np.pi)
    across = way + np.pi / 2 + rng.normal(0, 0.15)
    along = x * np.cos(way) + y * np.sin(way) + 4000
    aside = x * np.cos(across) + y * np.sin(across) + 4000
    return along.astype(np.float32), aside.astype(np.float32)


def _tiles(shape: tuple[int, int], rng: np.random.Generator) -> Float32Array:
    """Return tiles, bricks or planks with joints between them."""
    along, aside = _turned(shape, rng)
    side = np.exp(rng.uniform(np.log(30), np.log(300)))
    length = side * rng.choice([1, 1, 2, 30])
    row, shift = np.floor(aside / side), rng.choice([0.0, 0.5])
    along = along + shift * length * (row % 2) + (length > 3 * side) * 1000 * np.sin(row)
    column = np.floor(along / length)
    tile = (row * 57 + column * 31).astype(np.int64) % 512
    colours = _colours(1, rng)[0] + 0.2 * rng.random() * rng.standard_normal((512, 1))
    table = colours.astype(np.float32)[tile]
    if rng.random() < 0.5:  # veins along each tile
        lines = ndimage.gaussian_filter1d(rng.standard_normal(8000), rng.uniform(0.5, 4))
        vein = lines[(aside + 97 * column).astype(np.int64) % 8000]
        table = table + (0.15 * rng.random() * vein[..., None]).astype(np.float32)
    joint = np.minimum(along % length, aside % side) < rng.uniform(1, 8)
    table[joint] = _colours(1, rng)[0]
    return table


def _bands(shape: tuple[int, int], rng: np.random.Generator) -> Float32Array:
    """Return bands of cloth or carpet that cross, each as a half-transparent colour."""
    table = np.broadcast_to(_colours(1, rng)[0], (*shape, 3))
    ways = _turned(shape, rng)
    for colour in _colours(int(rng.integers(2, 9)), rng):
        period = np.exp(rng.uniform(np.log(8), np.log(300)))
        phase, share = rng.random() * period, rng.uniform(0.1, 0.5)
        band = (ways[rng.integers(2)] + phase) % period < share * period
        strength = (rng.uniform(0.2, 1) * band[..., None]).astype(np.float32)
        table = table + strength * (colour - table)
    return np.asarray(table)


def _litter(shape: tuple[int, int], rng: np.random.Generator) -> Float32Array:
    table = np.broadcast_to(_colours(1, rng)[0], (*shape, 3))
    return _scattered(table, rng)


def _scattered(table: Float32Array, rng: np.random.Generator) -> Float32Array:
    """Return a table with flat ellipses, rectangles or strokes on it, of about one size."""
    table = np.ascontiguousarray(table)
    height, width = table.shape[:2]
    size = np.exp(rng.uniform(np.log(4), np.log(60)))
    count = int(rng.uniform(0.1, 1) * min(height * width / (4 * size**2), 500)) + 3
    colours, kind = _colours(6, rng), rng.integers(3)
    for _ in range(count):
        colour = [float(value) for value in colours[rng.integers(6)] * rng.uniform(0.8, 1.2)]
        middle = rng.uniform(0, [width, height])
        half = size * np.exp(rng.normal(0, 0.3, 2)) * (1, rng.uniform(0.3, 1))
        angle = rng.uniform(0, 360)
        if kind == 0:
            box = [int(value) for value in half + 1]
            centre = (int(middle[0]), int(middle[1]))
            cv2.ellipse(table, centre, box, angle, 0, 360, colour, -1, cv2.LINE_AA)
        elif kind == 1:
            corners = cv2.boxPoints((middle.tolist(), (2 * half).tolist(), angle))
            cv2.fillConvexPoly(table, corners.astype(np.int32), colour, cv2.LINE_AA)
        else:
            turns = np.radians(angle) + np.cumsum(rng.normal(0, 0.4, 8))
            steps = half[0] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
            line = (middle + np.cumsum(steps, axis=0)).astype(np.int32)
            thick = int(rng.uniform(1, max(2.0, half[0] / 2)))
            cv2.polylines(table, [line], isClosed=False, color=colour, thickness=thick)
    return table


_PATTERNS: Final[tuple[Pattern, ...]] = (_cells, _tiles, _bands, _litter)
