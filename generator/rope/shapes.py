"""Control points of the flat shapes: open, loop, overlap, and the two knots.

A plan is drawn at random and may fail (a strand lying in another, a bend too tight); the
sampler then draws the next one from the same generator.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from pliant.generator.rope.curve import resample
from pliant.generator.rope.settings import RopeSettings
from pliant.generator.subject import FloatArray

BoolArray = npt.NDArray[np.bool_]

_SAMPLES: Final = 512


@dataclass(frozen=True)
class Plan:
    """A flat curve and which strand is the upper one where it crosses itself.

    Attributes:
        nodes: float64 (n, 2), control points in order, metres.
        late_over: Takes the positions (0..1 along the curve) of the earlier and of the later
            passage of each crossing, float64 (c,) each in order of the later one, and returns
            bool (c,): the later passage is the upper one.
        crossings: Least and largest number of crossings of this shape.
        spans: Least and largest distance along the curve, 0..1, between the two passages of a
            crossing.
        detail: What was drawn, for the sequence's record.
    """

    nodes: FloatArray
    late_over: Callable[[FloatArray, FloatArray], BoolArray]
    crossings: tuple[int, int]
    spans: tuple[float, float]
    detail: dict[str, float | str | bool]


def plan_shape(shape: str, settings: RopeSettings, rng: np.random.Generator) -> Plan:
    """Return one random plan of a shape.

    Args:
        shape: One of `SHAPES`.
        settings: Proportions.
        rng: Where the numbers come from.

    Returns:
        The plan; it may turn out not to be feasible.
    """
    if shape == "open":
        return _open(settings, rng)
    if shape == "loop":
        return _loop(settings, rng)
    if shape == "overlap":
        return _overlap(settings, rng)
    names = [name for name, weight in settings.knots.items() if weight > 0]
    weights = np.array([settings.knots[name] for name in names])
    knot = names[int(rng.choice(len(names), p=weights / weights.sum()))]
    return _knot(knot, settings, rng)


def _wander(
    rng: np.random.Generator, strength: float, slowest: float, fastest: float
) -> FloatArray:
    """Return a smooth random heading over the curve, radians: (samples,)."""
    t = np.linspace(0.0, 1.0, _SAMPLES)
    heading = np.zeros(_SAMPLES)
    for _ in range(3):
        waves = rng.uniform(slowest, fastest)
        phase = rng.uniform(0.0, 2.0 * math.pi)
        heading += rng.normal(0.0, strength) / 1.7 * np.sin(2.0 * math.pi * waves * t + phase)
    return heading


def _turn(start: float, end: float, angle: float) -> FloatArray:
    """Return a heading that turns by `angle` between two positions, smoothly: (samples,)."""
    t = np.linspace(0.0, 1.0, _SAMPLES)
    u = np.clip((t - start) / (end - start), 0.0, 1.0)
    # Curvature rises and falls over a quarter at each end, constant between.
    return np.asarray(angle * (u - 0.35 * np.sin(2.0 * math.pi * u) / (2.0 * math.pi)))


def _walk(heading: FloatArray, length_m: float) -> FloatArray:
    """Return the curve of a heading: float64 (samples, 2), metres."""
    step = length_m / (_SAMPLES - 1)
    middle = (heading[1:] + heading[:-1]) / 2.0
    moves = step * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])


def _place_nodes(path: FloatArray, count: int) -> FloatArray:
    """Return control points along a path, closer together where it bends: (count, 2)."""
    steps = np.diff(path, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    bend = np.abs(np.diff(heading, append=heading[-1]))
    weight = 1.0 / len(steps) + 0.9 * bend / max(float(bend.sum()), 2.0)
    reached = np.concatenate([np.zeros(1), np.cumsum(weight)])
    at = np.interp(np.linspace(0.0, reached[-1], count), reached, np.arange(len(path)))
    order = np.arange(len(path))
    return np.stack([np.interp(at, order, path[:, k]) for k in range(2)], axis=1)


def _later_over(_early: FloatArray, late: FloatArray) -> BoolArray:
    return np.ones(len(late), dtype=bool)


def _later_under(_early: FloatArray, late: FloatArray) -> BoolArray:
    return np.zeros(len(late), dtype=bool)


def _over_then_under(_early: FloatArray, late: FloatArray) -> BoolArray:
    return np.arange(len(late)) % 2 == 0


def _under_then_over(_early: FloatArray, late: FloatArray) -> BoolArray:
    return np.arange(len(late)) % 2 == 1


def _open(settings: RopeSettings, rng: np.random.Generator) -> Plan:
    heading = _wander(rng, rng.uniform(0.5, 1.6), 0.4, 2.2)
    nodes = _place_nodes(_walk(heading, settings.length_m), settings.control_points)
    # The paper's "some nodes pulled": a few are displaced.
    pulled = rng.random(len(nodes)) < 0.25
    nodes = nodes + pulled[:, None] * rng.normal(0.0, 0.018 * settings.length_m, nodes.shape)
    return Plan(nodes, _later_over, (0, 0), (0.0, 1.0), {"pulled_nodes": float(pulled.sum())})


def _loop(settings: RopeSettings, rng: np.random.Generator) -> Plan:
    radius = rng.uniform(*settings.loop_radius_m)
    tucked = bool(rng.random() < 0.5)
    side = -1.0 if rng.random() < 0.5 else 1.0
    angle = 2.0 * math.pi + rng.uniform(-0.5, 0.6)
    # A tuck goes on turning until the end passes through the loop a second time.
    if tucked:
        angle += rng.uniform(0.5, 1.3)
    share = angle * radius / settings.length_m
    start = rng.uniform(0.15, max(0.16, 0.85 - share))
    heading = _wander(rng, rng.uniform(0.3, 0.9), 0.4, 1.5) + _turn(
        start, start + share, side * angle
    )
    path = _walk(heading, settings.length_m)
    if rng.random() < 0.5:
        path = path[::-1]
    nodes = _place_nodes(path, settings.control_points)
    layers = (_over_then_under, _under_then_over) if tucked else (_later_over, _later_under)
    detail: dict[str, float | str | bool] = {"loop_radius_m": radius, "tucked": tucked}
    crossings = (2, 2) if tucked else (1, 2)
    spans = (0.0, 1.0) if tucked else (0.0, 0.6)
    return Plan(nodes, layers[int(rng.integers(2))], crossings, spans, detail)


def _overlap(settings: RopeSettings, rng: np.random.Generator) -> Plan:
    if rng.random() < 0.5:
        heading = _wander(rng, rng.uniform(2.2, 3.6), 0.3, 1.6)
    else:
        # One wide turn that brings an end back over the other half.
        angle = rng.uniform(1.25, 1.8) * math.pi * (-1.0 if rng.random() < 0.5 else 1.0)
        start = rng.uniform(0.1, 0.3)
        heading = _wander(rng, 0.6, 0.4, 1.5) + _turn(start, start + rng.uniform(0.4, 0.6), angle)
    nodes = _place_nodes(_walk(heading, settings.length_m), settings.control_points)
    layers = (_later_over, _later_under)
    return Plan(nodes, layers[int(rng.integers(2))], (1, 3), (0.33, 1.0), {})


def _knot_core(knot: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return parameter, plan and height hint of a knot opened on an outer lobe.

    The overhand is the trefoil (sin t + 2 sin 2t, cos t - 2 cos 2t, -sin 3t), the figure-eight
    ((2 + cos 2t) cos 3t, (2 + cos 2t) sin 3t, sin 4t), both textbook curves.
    """
    if knot == "overhand":
        start, cut = math.pi / 3.0, 0.50
        t = np.linspace(start + cut, start + 2.0 * math.pi - cut, _SAMPLES)
        plan = np.stack(
            [np.sin(t) + 2.0 * np.sin(2.0 * t), np.cos(t) - 2.0 * np.cos(2.0 * t)], axis=1
        )
        return t, plan, -np.sin(3.0 * t)
    cut = 0.30
    t = np.linspace(cut, 2.0 * math.pi - cut, _SAMPLES)
    reach = 2.0 + np.cos(2.0 * t)
    plan = np.stack([reach * np.cos(3.0 * t), reach * np.sin(3.0 * t)], axis=1)
    return t, plan, np.sin(4.0 * t)


_KNOT_NODES: Final = {"overhand": 14, "figure-eight": 20}
_TAIL_NODES: Final = 4


def _knot(knot: str, settings: RopeSettings, rng: np.random.Generator) -> Plan:
    low, high = settings.knot_diameters[knot]
    size = rng.uniform(low, high)
    core_length = size * settings.diameter_m
    _, core, hint = _knot_core(knot)
    # A little irregularity, in the plane only: stretch, and a smooth bulge.
    stretch = rng.uniform(0.9, 1.12)
    core = core * np.array([stretch, 1.0 / stretch])
    if rng.random() < 0.5:
        core, hint = core * np.array([1.0, -1.0]), -hint  # the mirror image of both: a turn over
    if rng.random() < 0.5:
        hint = -hint  # the other hand
    length = float(np.sqrt((np.diff(core, axis=0) ** 2).sum(axis=1)).sum())
    core = core * (core_length / length)
    spare = settings.length_m - core_length
    share = rng.uniform(0.35, 0.65)
    before = _tail(core[0] - core[1], core[0] - core.mean(axis=0), spare * share, rng)
    after = _tail(core[-1] - core[-2], core[-1] - core.mean(axis=0), spare * (1 - share), rng)
    inner = resample(core, _KNOT_NODES[knot])
    wiggle = rng.normal(0.0, 0.004 * core_length, inner.shape)
    wiggle[[0, -1]] = 0.0
    nodes = np.concatenate([core[0] + before[::-1], inner + wiggle, core[-1] + after])
    first = spare * share / settings.length_m
    last = 1.0 - spare * (1 - share) / settings.length_m
    along = np.linspace(first, last, len(hint))
    core_arc = np.concatenate(
        [np.zeros(1), np.cumsum(np.sqrt((np.diff(core, axis=0) ** 2).sum(axis=1)))]
    )
    along = first + (last - first) * core_arc / core_arc[-1]

    def late_over(early: FloatArray, late: FloatArray) -> BoolArray:
        return np.asarray(np.interp(late, along, hint) > np.interp(early, along, hint))

    count = 3 if knot == "overhand" else 4
    detail: dict[str, float | str | bool] = {"knot": knot, "knot_diameters": size}
    return Plan(nodes, late_over, (count, count), (0.0, 1.0), detail)


def _tail(
    direction: FloatArray, outward: FloatArray, length_m: float, rng: np.random.Generator
) -> FloatArray:
    """Return control points of a tail that leaves the knot and bends outward: (nodes, 2)."""
    heading = math.atan2(direction[1], direction[0])
    away = math.atan2(outward[1], outward[0])
    turn = (away - heading + math.pi) % (2.0 * math.pi) - math.pi
    t = np.linspace(0.0, 1.0, 65)
    bend = rng.uniform(0.3, 1.5) * turn * t + rng.normal(0.0, 0.5) * np.sin(math.pi * t)
    angle = heading + bend
    step = length_m / 64.0
    moves = step * np.stack([np.cos(angle), np.sin(angle)], axis=1)[1:]
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    return resample(path, _TAIL_NODES + 1)[1:]
