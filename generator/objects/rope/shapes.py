"""Control points of the flat shapes: open, loop, overlap, and the two knots.

A plan is drawn at random and may fail (a strand lying in another, a bend too tight); the
sampler then draws the next one from the same generator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pliant.generator import portable
from pliant.generator.objects.rope.curve import (
    arc_length,
    automatic_handles,
    bezier_curve,
    resample,
)
from pliant.generator.seeding import weighted_choice
from pliant.generator.settings.rope import RopeSettings
from pliant.spec.arrays import BoolArray, FloatArray

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
    detail: Mapping[str, object]


def sample_variant(shape: str, settings: RopeSettings, rng: np.random.Generator) -> str:
    """Return which kind of its shape a configuration has, drawn once for all its attempts.

    So a kind that is harder to make does not become rarer.

    Args:
        shape: One of `SHAPES`.
        settings: Weights of the knots.
        rng: Where the numbers come from.

    Returns:
        A knot; `tucked` or `plain` for a loop; `plain` for the others.
    """
    if shape == "knot":
        return weighted_choice(rng, settings.knots)
    return "tucked" if shape == "loop" and rng.random() < 0.5 else "plain"


def plan_shape(shape: str, variant: str, settings: RopeSettings, rng: np.random.Generator) -> Plan:
    """Return one random plan of a shape.

    Args:
        shape: One of `SHAPES`.
        variant: What `sample_variant` returned.
        settings: Proportions.
        rng: Where the numbers come from.

    Returns:
        The plan; it may turn out not to be feasible.
    """
    if shape == "open":
        return _open(settings, rng)
    if shape == "loop":
        return _tucked(settings, rng) if variant == "tucked" else _loop(settings, rng)
    if shape == "overlap":
        return _overlap(settings, rng)
    return _knot(variant, settings, rng)


def _wander(
    rng: np.random.Generator, strength: float, slowest: float, fastest: float
) -> FloatArray:
    """Return a smooth random heading over the curve, radians: (samples,)."""
    t = np.linspace(0.0, 1.0, _SAMPLES)
    heading = np.zeros(_SAMPLES)
    for _ in range(3):
        waves = rng.uniform(slowest, fastest)
        phase = rng.uniform(0.0, 2.0 * math.pi)
        heading += rng.normal(0.0, strength) / 1.7 * portable.sin(2.0 * math.pi * waves * t + phase)
    return heading


def _turn(start: float, end: float, angle: float) -> FloatArray:
    """Return a heading that turns by `angle` between two positions, smoothly: (samples,)."""
    t = np.linspace(0.0, 1.0, _SAMPLES)
    u = np.clip((t - start) / (end - start), 0.0, 1.0)
    # Curvature rises and falls over a quarter at each end, constant between.
    return np.asarray(angle * (u - 0.35 * portable.sin(2.0 * math.pi * u) / (2.0 * math.pi)))


def _walk(heading: FloatArray, length_m: float) -> FloatArray:
    """Return the curve of a heading: float64 (samples, 2), metres."""
    step = length_m / (_SAMPLES - 1)
    middle = (heading[1:] + heading[:-1]) / 2.0
    moves = step * np.stack([portable.cos(middle), portable.sin(middle)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])


def _place_nodes(path: FloatArray, count: int) -> FloatArray:
    """Return control points along a path, closer together where it bends: (count, 2)."""
    steps = np.diff(path, axis=0)
    heading = np.unwrap(portable.arctan2(steps[:, 1], steps[:, 0]))
    bend = np.abs(np.diff(heading, append=heading[-1]))
    weight = 1.0 / len(steps) + 0.9 * bend / max(float(bend.sum()), 2.0)
    reached = np.concatenate([np.zeros(1), np.cumsum(weight)])
    at = np.interp(np.linspace(0.0, reached[-1], count), reached, np.arange(len(path)))
    order = np.arange(len(path))
    return np.stack([np.interp(at, order, path[:, k]) for k in range(2)], axis=1)


def _in_turn(*late_over: bool) -> Callable[[FloatArray, FloatArray], BoolArray]:
    """Return a plan's `late_over` that gives the crossings these values in turn."""
    return lambda _early, late: np.resize(np.array(late_over), len(late))


def _open(settings: RopeSettings, rng: np.random.Generator) -> Plan:
    heading = _wander(rng, rng.uniform(0.5, 1.6), 0.4, 2.2)
    nodes = _place_nodes(_walk(heading, settings.length_m), settings.control_points)
    # The paper's "some nodes pulled": a few are displaced.
    pulled = rng.random(len(nodes)) < 0.25
    nodes = nodes + pulled[:, None] * rng.normal(0.0, 0.018 * settings.length_m, nodes.shape)
    return Plan(nodes, _in_turn(True), (0, 0), (0.0, 1.0), {"pulled_nodes": float(pulled.sum())})


def _loop(settings: RopeSettings, rng: np.random.Generator) -> Plan:
    radius = rng.uniform(*settings.loop_radius_m)
    side = -1.0 if rng.random() < 0.5 else 1.0
    angle = 2.0 * math.pi + rng.uniform(-0.5, 0.6)
    share = angle * radius / settings.length_m
    start = rng.uniform(0.15, max(0.16, 0.85 - share))
    heading = _wander(rng, rng.uniform(0.4, 1.4), 0.4, 1.6) + _turn(
        start, start + share, side * angle
    )
    nodes = _place_nodes(_walk(heading, settings.length_m), settings.control_points)
    over = rng.integers(2) == 0
    detail = {"loop_radius_m": radius, "tucked": False}
    return Plan(nodes, _in_turn(over), (1, 2), (0.0, 0.6), detail)


def _tucked(settings: RopeSettings, rng: np.random.Generator) -> Plan:
    """A loop near an end, and the end turned back through it: over once and under once."""
    radius = rng.uniform(*settings.loop_radius_m)
    side = -1.0 if rng.random() < 0.5 else 1.0
    loop = 2.0 * math.pi + rng.uniform(-0.3, 0.3)
    back = rng.uniform(0.75, 1.0) * math.pi
    back_radius = max(0.55 * radius, 2.2 * settings.radius_m)
    away = rng.uniform(0.7, 1.1) * radius + back_radius
    inside = away + rng.uniform(-0.1, 0.5) * radius
    stretches = np.array([loop * radius, away, back * back_radius, inside]) / settings.length_m
    ends = 1.0 - np.cumsum(stretches[::-1])[::-1]
    heading = (
        _wander(rng, rng.uniform(0.3, 1.0), 0.4, 1.2)
        + _turn(ends[0], ends[1], side * loop)
        + _turn(ends[2], ends[3], side * back)
    )
    path = _walk(heading, settings.length_m)
    # The ball does not go through the loop.
    if not settings.ball and rng.random() < 0.5:
        path = path[::-1]
    nodes = _place_nodes(path, settings.control_points)
    over = rng.integers(2) == 0
    detail = {"loop_radius_m": radius, "tucked": True}
    return Plan(nodes, _in_turn(over, not over), (2, 2), (0.0, 1.0), detail)


def _overlap(settings: RopeSettings, rng: np.random.Generator) -> Plan:
    if rng.random() < 0.5:
        heading = _wander(rng, rng.uniform(2.2, 3.6), 0.3, 1.6)
    else:
        # One wide turn that brings an end back over the other half.
        angle = rng.uniform(1.25, 1.8) * math.pi * (-1.0 if rng.random() < 0.5 else 1.0)
        start = rng.uniform(0.1, 0.3)
        heading = _wander(rng, 0.6, 0.4, 1.5) + _turn(start, start + rng.uniform(0.4, 0.6), angle)
    nodes = _place_nodes(_walk(heading, settings.length_m), settings.control_points)
    over = rng.integers(2) == 0
    return Plan(nodes, _in_turn(over), (1, 3), (0.33, 1.0), {})


# Two knots drawn as a lying figure of eight: three strands run through the waist, and each
# tail leaves through the loop at the other end. Going along either, over and under alternate.
# In the overhand the two tails cross in the waist; in the figure-eight the middle strand goes
# from one loop's bottom to the other's top and crosses both.
_THROUGH_LOOPS: Final = {
    "overhand": np.array(
        [
            *[(3.9, -0.1), (2.6, 0.05), (1.1, 0.0), (-1.0, -0.9), (-2.2, -1.1), (-3.2, -0.1)],
            *[(-2.3, 1.0), (-0.9, 1.25), (0.9, 1.25), (2.3, 1.0), (3.2, -0.1), (2.2, -1.1)],
            *[(1.0, -0.9), (-1.1, 0.0), (-2.6, 0.05), (-3.9, -0.1)],
        ]
    ),
    "figure-eight": np.array(
        [
            *[(4.1, 0.0), (2.7, 0.05), (1.3, 0.3), (0.0, 0.8), (-1.2, 1.15), (-2.4, 1.15)],
            *[(-3.3, 0.1), (-2.5, -1.1), (-1.3, -0.75), (0.0, 0.0), (1.3, 0.75), (2.5, 1.1)],
            *[(3.3, -0.1), (2.4, -1.15), (1.2, -1.15), (0.0, -0.8), (-1.3, -0.3)],
            *[(-2.7, -0.05), (-4.1, 0.0)],
        ]
    ),
}


def _pretzel() -> FloatArray:
    """Return the trefoil (sin t + 2 sin 2t, cos t - 2 cos 2t), opened on an outer lobe."""
    start, cut = math.pi / 3.0, 0.50
    t = np.linspace(start + cut, start + 2.0 * math.pi - cut, _SAMPLES)
    x = portable.sin(t) + 2.0 * portable.sin(2.0 * t)
    y = portable.cos(t) - 2.0 * portable.cos(2.0 * t)
    return np.stack([x, y], axis=1)


def _knot_core(knot: str, pretzel: bool) -> FloatArray:
    """Return the knotted stretch as seen from above: (samples, 2), no particular size."""
    if pretzel:
        return _pretzel()
    nodes = _THROUGH_LOOPS[knot]
    return resample(bezier_curve(nodes, automatic_handles(nodes)), _SAMPLES)


_KNOT_NODES: Final = {"overhand": 16, "figure-eight": 18}
_TAIL_NODES: Final = 4


def _knot(knot: str, settings: RopeSettings, rng: np.random.Generator) -> Plan:
    size = rng.uniform(*settings.knot_diameters[knot])
    core_length = size * settings.diameter_m
    pretzel = knot == "overhand" and bool(rng.random() < 0.4)
    # A little irregularity: stretched one way, mirrored, nodes displaced.
    stretch = rng.uniform(0.92, 1.12)
    mirror = -1.0 if rng.random() < 0.5 else 1.0
    core = _knot_core(knot, pretzel) * np.array([stretch, mirror / stretch])
    core *= core_length / arc_length(core)[-1]
    spare = settings.length_m - core_length
    share = rng.uniform(0.35, 0.65)
    # Each tail bends away from the other one.
    across = core[0] - core[-1] if pretzel else core[len(core) // 2] - core[0]
    before = _tail(core[0] - core[1], across, spare * share, rng)
    after = _tail(core[-1] - core[-2], -across, spare * (1 - share), rng)
    inner = resample(core, _KNOT_NODES[knot])
    wiggle = rng.normal(0.0, 0.003 * core_length, inner.shape)
    wiggle[[0, -1]] = 0.0
    nodes = np.concatenate([core[0] + before[::-1], inner + wiggle, core[-1] + after])
    starts_over = bool(rng.random() < 0.5)

    def late_over(early: FloatArray, late: FloatArray) -> BoolArray:
        # Over and under alternate along the rope; which comes first is the knot's hand.
        passages = np.sort(np.concatenate([early, late]))
        return np.asarray((np.searchsorted(passages, late) % 2 == 0) == starts_over)

    count = 3 if knot == "overhand" else 4
    detail = {"knot": knot, "knot_diameters": size, "pretzel": pretzel}
    return Plan(nodes, late_over, (count, count), (0.0, 1.0), detail)


def _tail(
    direction: FloatArray, side: FloatArray, length_m: float, rng: np.random.Generator
) -> FloatArray:
    """Return control points of a tail that leaves the knot and bends to a side: (nodes, 2)."""
    heading = math.atan2(direction[1], direction[0])
    left = direction[0] * side[1] - direction[1] * side[0] > 0
    t = np.linspace(0.0, 1.0, 65)
    bend = rng.uniform(-0.2, 1.8) * (1.0 if left else -1.0) * np.sqrt(t)
    angle = heading + bend + rng.normal(0.0, 0.5) * portable.sin(math.pi * t) * t
    step = length_m / 64.0
    moves = step * np.stack([portable.cos(angle), portable.sin(angle)], axis=1)[1:]
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    return resample(path, _TAIL_NODES + 1)[1:]
