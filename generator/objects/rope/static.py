"""One configuration of the rope at rest: a plan made into a curve in space, or rejected."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pliant.generator.objects.rope.contact import STATIC_RULE, nearest_stretches, plane_crossings
from pliant.generator.objects.rope.curve import (
    arc_length,
    automatic_handles,
    bezier_curve,
    first_direction,
    resample,
    tightest_bend,
)
from pliant.generator.objects.rope.lift import lift
from pliant.generator.objects.rope.mesh import BALL_DEPTH
from pliant.generator.objects.rope.shapes import Plan, plan_shape, sample_variant
from pliant.generator.settings.rope import RopeSettings
from pliant.spec.arrays import FloatArray
from pliant.spec.errors import GenerationError

MIN_BEND_RADII: Final = 1.8
"""Tightest bend of a sampled centre line, in rope radii: below 1 the surface would fold."""

ATTEMPTS: Final = 1500
"""Plans drawn before a shape is given up; most shapes take fewer than 30."""

_LENGTH_TOLERANCES: Final = (2e-6, 1e-3)
"""Relative errors of a plan's length that are scaled away. The length jumps by about 5e-4 where the
lift covers one more sample, so a few lengths in 10,000 are only reached with the second one."""


@dataclass(frozen=True)
class Configuration:
    """A rope at rest.

    Attributes:
        centreline: float64 (rows, 3), metres, equal arc length, centred on the origin.
        control_points: float64 (n, 2), of the curve as seen from above, metres.
        handles: float64 (n, 2, 2), left and right handle of each, metres.
        ball_centre: float64 (3,), metres, or None.
        attempts: Plans drawn until one held.
        detail: What the shape's plan recorded.
    """

    centreline: FloatArray
    control_points: FloatArray
    handles: FloatArray
    ball_centre: FloatArray | None
    attempts: int
    detail: Mapping[str, Any]


def sample_configuration(
    shape: str, settings: RopeSettings, rng: np.random.Generator
) -> Configuration:
    """Draw configurations of a shape until one is physically possible.

    Args:
        shape: One of `SHAPES`.
        settings: Proportions.
        rng: Where the numbers come from.

    Returns:
        The configuration.

    Raises:
        GenerationError: None held; the settings leave the shape too little room.
    """
    variant = sample_variant(shape, settings, rng)
    most = len(_LENGTH_TOLERANCES) * ATTEMPTS
    for attempt in range(1, most + 1):
        tolerance = _LENGTH_TOLERANCES[(attempt - 1) // ATTEMPTS]
        plan = plan_shape(shape, variant, settings, rng)
        made = _build(plan, settings, rng, attempt, tolerance)
        if made is not None:
            return made
    kind = shape if variant == "plain" else f"{variant} {shape}"
    raise GenerationError(
        f"no valid {kind} was found in {most} attempts",
        where="rope",
        fix="Make the rope longer or thinner, widen the workspace, use fewer control_points, or "
        "leave this shape out.",
    )


def ball_centre_of(centreline: FloatArray, settings: RopeSettings) -> FloatArray:
    """Return where the ball's centre is: straight on from the rope's first point.

    Args:
        centreline: float64 (n, 3), metres.
        settings: Proportions.

    Returns:
        float64 (3,), metres.
    """
    into = first_direction(centreline)
    centre = centreline[0] - BALL_DEPTH * settings.ball_radius_m * into
    centre[2] = max(centre[2], settings.ball_radius_m)
    return np.asarray(centre)


def _build(
    plan: Plan, settings: RopeSettings, rng: np.random.Generator, attempt: int, tolerance: float
) -> Configuration | None:
    nodes = _turned_into_workspace(plan.nodes, settings, rng)
    handles = automatic_handles(nodes)
    flat = bezier_curve(nodes, handles)
    scale = settings.length_m / arc_length(flat)[-1]
    if not 0.8 < scale < 1.25:
        return None
    samples = 2 * settings.rows - 1
    flat = resample(flat, samples)
    crossing = plane_crossings(flat)
    crossing = crossing[np.argsort(crossing[:, 1], kind="stable")]
    if not _as_planned(plan, crossing, samples):
        return None
    late_over = plan.late_over(crossing[:, 0] / (samples - 1), crossing[:, 1] / (samples - 1))
    for _ in range(12):
        # Climbing takes length: shrink the plan until the whole is as long as the rope.
        xy = scale * flat
        z = lift(xy, crossing, late_over, _floor(settings, samples), settings.diameter_m)
        if z is None:
            return None
        curve = np.concatenate([xy, z[:, None]], axis=1)
        length = float(arc_length(curve)[-1])
        if abs(length / settings.length_m - 1.0) < tolerance:
            break
        scale *= settings.length_m / length
    else:
        return None
    curve *= settings.length_m / length
    scale *= settings.length_m / length
    centreline = resample(curve, settings.rows)
    if tightest_bend(centreline) < MIN_BEND_RADII * settings.radius_m:
        return None
    nearest = nearest_stretches(centreline, settings.length_m, settings.diameter_m)
    if nearest < STATIC_RULE * settings.diameter_m:
        return None
    ball = None
    if settings.ball:
        ball = ball_centre_of(centreline, settings)
        ball[2] = settings.ball_radius_m  # the first point's own height, to a tenth of a millimetre
        if not _clear_of_ball(centreline, ball, settings):
            return None
    shift = _centre(centreline, ball, settings)
    if shift is None:
        return None
    return Configuration(
        centreline=centreline - np.append(shift, 0.0),
        control_points=scale * nodes - shift,
        handles=scale * handles - shift,
        ball_centre=None if ball is None else ball - np.append(shift, 0.0),
        attempts=attempt,
        detail=plan.detail,
    )


def _turned_into_workspace(
    nodes: FloatArray, settings: RopeSettings, rng: np.random.Generator
) -> FloatArray:
    """Turn the plan to a random heading, its long side nearer to the workspace's."""
    centred = nodes - nodes.mean(axis=0)
    xx, yy = (centred**2).mean(axis=0)
    xy = float((centred[:, 0] * centred[:, 1]).mean())
    heading = 0.5 * math.atan2(2.0 * xy, float(xx - yy))
    turn = rng.normal(0.0, 0.5) - heading + (math.pi if rng.random() < 0.5 else 0.0)
    if settings.workspace[1] > settings.workspace[0]:
        turn += math.pi / 2.0
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = centred[:, 0], centred[:, 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)


def _as_planned(plan: Plan, crossing: FloatArray, samples: int) -> bool:
    least, most = plan.crossings
    if not least <= len(crossing) <= most:
        return False
    spans = (crossing[:, 1] - crossing[:, 0]) / (samples - 1)
    return bool(((spans >= plan.spans[0]) & (spans <= plan.spans[1])).all())


def _floor(settings: RopeSettings, samples: int) -> FloatArray:
    """Least height along the rope: its radius, and the ball's at the ball's end."""
    floor = np.full(samples, settings.radius_m)
    if settings.ball:
        floor[: max(2, round(0.004 * samples))] = settings.ball_radius_m
    return floor


def _clear_of_ball(centreline: FloatArray, ball: FloatArray, settings: RopeSettings) -> bool:
    reach = settings.ball_radius_m + settings.radius_m
    distance = np.sqrt(((centreline - ball) ** 2).sum(axis=1))
    step = settings.length_m / (len(centreline) - 1)
    near = math.ceil(1.5 * reach / step)
    return bool(distance[near:].min() > 1.02 * reach)


def _centre(
    centreline: FloatArray, ball: FloatArray | None, settings: RopeSettings
) -> FloatArray | None:
    """Return the middle of the rope's box as seen from above, or None if it is too large."""
    low = centreline[:, :2].min(axis=0) - settings.radius_m
    high = centreline[:, :2].max(axis=0) + settings.radius_m
    if ball is not None:
        low = np.minimum(low, ball[:2] - settings.ball_radius_m)
        high = np.maximum(high, ball[:2] + settings.ball_radius_m)
    if ((high - low) > np.array(settings.workspace) * settings.length_m).any():
        return None
    return np.asarray((low + high) / 2.0)
