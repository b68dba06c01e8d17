"""Ropes, cables and cloths next to the queried object, which are in the picture and in the truth.

Each is an object of the scene like any other: it has its own id in the surface images, casts
shadows, and hides what is below it. Nothing is asked about it. It is laid over what is there
already, so that no two surfaces pass through each other; the queried object stays as it is.
"""

from __future__ import annotations

import colorsys
import math
from dataclasses import replace
from typing import Final

import numpy as np

from pliant.generator import portable
from pliant.generator.scene.appearance import linear_reflectance
from pliant.generator.scene.scene_object import Part, Pose, SceneObject, quads
from pliant.generator.seeding import RandomStreams, Stream, weighted_choice
from pliant.generator.settings.scene import SceneSettings
from pliant.spec.arrays import FloatArray
from pliant.spec.model import DISTRACTOR

_LENGTH_M: Final = (0.4, 1.3)
_RADIUS_M: Final = {"rope": (0.005, 0.012), "cable": (0.0015, 0.004)}
_SIDE_M: Final = (0.12, 0.4)
_SHEET_M: Final = 0.001
"""Height of a cloth above what is below it."""

_STEP_M: Final = 0.008
_RING: Final = 10
_SLOPE: Final = 0.6
"""Rise per metre of what goes over something else."""

_CELL_M: Final = 0.005
_PLACES: Final = 12
"""Places tried for each; the one that fits is taken."""

EXTENT_M: Final = 2.0
"""Bound of the rest coordinates: what material coordinate 1 stands for."""


def add_distractors(
    scene_object: SceneObject, streams: RandomStreams, settings: SceneSettings
) -> SceneObject:
    """Return configurations with distractors; kinds, sizes and colours are those of the sequence.

    Args:
        scene_object: Independent configurations.
        streams: Source of what there is, and for each frame of where it is.
        settings: How many of which kind, and how often one goes over the object.
    """
    rng = streams.generator(Stream.DISTRACTORS)
    low, high = settings.distractors
    kinds = [
        weighted_choice(rng, settings.distractor_kinds)
        for _ in range(int(rng.integers(low, high + 1)))
    ]
    first = max(each.object_id for each in scene_object.parts) + 1
    shapes = [_Sheet(rng) if kind == "cloth" else _Tube(rng, _RADIUS_M[kind]) for kind in kinds]
    parts = tuple(
        Part(
            object_id=first + k,
            name=f"{DISTRACTOR}-{k + 1}",
            faces=shape.faces,
            rest=shape.rest,
            chart=_chart,
            strand=np.zeros(len(shape.rest), np.int32),
            double_sided=isinstance(shape, _Sheet),
            colour=_colour(rng),
        )
        for k, shape in enumerate(shapes)
    )

    def pose(frame: int) -> Pose:
        bare = scene_object.pose(frame)
        rng = streams.generator(Stream.DISTRACTORS, frame)
        vertices = dict(bare.vertices)
        own = np.concatenate(list(vertices.values()))
        below = _highest(own)
        for part, shape in zip(parts, shapes, strict=True):
            over = rng.random() < settings.distractor_over
            vertices[part.name] = shape.laid(_place(rng, shape, own, below, over=over), below)
            below = _highest(np.concatenate([below, vertices[part.name]]))
        return replace(bare, vertices=vertices)

    info = {**scene_object.info, "distractors": kinds}
    return replace(scene_object, parts=(*scene_object.parts, *parts), pose=pose, info=info)


class _Tube:
    """A rope or a cable: a smooth curve in the plane, and a tube around it."""

    def __init__(self, rng: np.random.Generator, radius_m: tuple[float, float]) -> None:
        length_m, self.radius_m = rng.uniform(*_LENGTH_M), rng.uniform(*radius_m)
        rows = round(length_m / _STEP_M)
        bends = rng.normal(0, 5.0, 5)  # curvature, 1/m, at five places along the curve
        share = np.linspace(0, 1, rows)
        heading = np.cumsum(np.interp(share, np.linspace(0, 1, 5), bends)) * _STEP_M
        steps = np.stack([portable.cos(heading), portable.sin(heading)], axis=1) * _STEP_M
        line = np.cumsum(steps, axis=0)
        self.plan = line - line.mean(axis=0)  # (rows, 2)
        theta = 2 * math.pi * np.arange(_RING) / _RING
        self._ring = np.stack([portable.cos(theta), portable.sin(theta)], axis=1)
        shrink = np.minimum(1.0, np.arange(rows) / 2)  # to a point at both ends
        self._radii = self.radius_m * np.minimum(shrink, shrink[::-1])
        across = self._radii[:, None, None] * self._ring[None]
        along = np.broadcast_to(share[:, None, None] * length_m, (rows, _RING, 1))
        self.rest = np.concatenate([along, across], axis=2).reshape(-1, 3)
        index = np.arange(rows * _RING).reshape(rows, _RING)
        after = np.roll(index, -1, axis=1)
        self.faces = quads(index[:-1], index[1:], after[1:], after[:-1])

    def laid(self, line: FloatArray, below: FloatArray) -> FloatArray:
        """Return the vertices around a centre line (rows, 2), float64 (V, 3)."""
        height = _supported(line, below, self.radius_m) + self.radius_m
        tangent = np.gradient(line, axis=0)
        tangent /= np.sqrt((tangent**2).sum(axis=1, keepdims=True))
        side = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
        across = self._radii[:, None, None] * self._ring[None]
        level = line[:, None] + across[..., :1] * side[:, None]
        return np.concatenate([level, height[:, None, None] + across[..., 1:]], axis=2).reshape(
            -1, 3
        )


class _Sheet:
    """A flat rectangle."""

    def __init__(self, rng: np.random.Generator) -> None:
        sides = rng.uniform(*_SIDE_M, 2)
        counts = np.round(sides / _STEP_M).astype(int)
        u, v = (np.linspace(-0.5, 0.5, n + 1) * side for n, side in zip(counts, sides, strict=True))
        self.plan = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        self.rest = np.insert(self.plan + np.array([0.5, 0.0]), 2, 0.0, axis=1)
        index = np.arange(len(self.plan)).reshape(len(u), len(v))
        self.faces = quads(index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])

    def laid(self, places: FloatArray, below: FloatArray) -> FloatArray:
        """Return the vertices at places (V, 2), float64 (V, 3)."""
        return np.column_stack([places, _supported(places, below, _STEP_M) + _SHEET_M])


def _place(
    rng: np.random.Generator,
    shape: _Tube | _Sheet,
    own: FloatArray,
    below: FloatArray,
    *,
    over: bool,
) -> FloatArray:
    """Return the plan (N, 2) turned and moved next to the object, or partly over it."""
    low, high = own[:, :2].min(axis=0), own[:, :2].max(axis=0)
    middle, reach = (low + high) / 2, (high - low).max() / 2
    best, cost = shape.plan, math.inf
    for _ in range(_PLACES):
        yaw, direction = rng.uniform(-math.pi, math.pi, 2)
        away = rng.uniform(0.3, 1.2) * reach
        cosine, sine = math.cos(yaw), math.sin(yaw)
        turned = portable.product(shape.plan, [[cosine, sine], [-sine, cosine]])
        moved = turned + middle + away * np.array([math.cos(direction), math.sin(direction)])
        share = float(np.mean(_supported(moved, below, _CELL_M) > 0))
        wrong = abs(share - 0.15) if over else share
        if wrong < cost:
            best, cost = moved, wrong
    return best


def _highest(vertices: FloatArray) -> FloatArray:
    """Return the highest vertex of each occupied cell of the table, float64 (C, 3)."""
    order = np.lexsort((-vertices[:, 2], *np.floor(vertices[:, :2] / _CELL_M).T))
    cells = np.floor(vertices[order, :2] / _CELL_M)
    first = np.ones(len(cells), dtype=np.bool_)
    first[1:] = (cells[1:] != cells[:-1]).any(axis=1)
    return vertices[order[first]]


def _supported(places: FloatArray, below: FloatArray, width_m: float) -> FloatArray:
    """Return the height of the gentlest surface over what is below, float64 (N,), 0 for the table.

    Args:
        places: float64 (N, 2).
        below: float64 (C, 3), highest vertices.
        width_m: Half the width of what is laid there.
    """
    reach = width_m + 2 * _CELL_M
    near = np.ones(len(below), dtype=np.bool_)
    for axis in (0, 1):
        margin = reach + below[:, 2] / _SLOPE
        near &= below[:, axis] >= places[:, axis].min() - margin
        near &= below[:, axis] <= places[:, axis].max() + margin
    height = np.zeros(len(places))
    for part in np.array_split(below[near], max(1, near.sum() // 512)):
        gap = np.sqrt(((places[:, None] - part[None, :, :2]) ** 2).sum(axis=2)) - reach
        height = np.maximum(height, (part[:, 2] - _SLOPE * gap.clip(0)).max(axis=1, initial=0))
    return height


def _colour(rng: np.random.Generator) -> tuple[float, float, float]:
    return linear_reflectance(
        colorsys.hsv_to_rgb(rng.random(), rng.uniform(0, 0.9), rng.uniform(0.05, 0.95))
    )


def _chart(rest: FloatArray) -> FloatArray:
    """Return the place along and across: not unique on a tube, nothing is asked here."""
    return np.clip(np.stack([rest[:, 0], rest[:, 1] + 0.5], axis=1) / EXTENT_M, 0.0, 1.0)
