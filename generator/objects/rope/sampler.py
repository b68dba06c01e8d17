"""A rope tier: what `dataset.json` says about it, and its sequences."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.rope.body import BALL_ID, ROPE_ID, RopeBody, upward_normal
from pliant.generator.objects.rope.episode import Episode
from pliant.generator.objects.rope.static import sample_configuration
from pliant.generator.scene.scene_object import Pose, SceneObject
from pliant.generator.seeding import RandomStreams, Stream, weighted_choice
from pliant.generator.settings.rope import RopeSettings
from pliant.spec.model import MaterialCoordinate, MaterialObject, Symmetry, Tier

REVERSAL: Final = Symmetry("reversal", ((-1.0, 0.0), (0.0, -1.0)), (1.0, 0.0))
"""(s, theta) -> (1 - s, -theta): the rope looked at from its other end."""


def describe(config: GenerateConfig, tier: str) -> Tier:
    """Return the rope tier of a dataset; ranges of proportions appear as their middle."""
    settings = config.rope.nominal
    along = MaterialCoordinate("s", 0.0, 1.0, settings.length_m)
    rope = MaterialObject(ROPE_ID, "rope", (along, _angle("theta", settings.radius_m)))
    if not settings.ball:
        return Tier(tier, "rope", "plain", ROPE_ID, (rope,), (REVERSAL,))
    radius_m = settings.ball_radius_m
    polar = MaterialCoordinate("polar", 0.0, math.pi, radius_m)
    ball = MaterialObject(BALL_ID, "ball", (polar, _angle("azimuth", radius_m)))
    return Tier(tier, "rope", "plain", ROPE_ID, (rope, ball))


def _angle(name: str, radius_m: float) -> MaterialCoordinate:
    return MaterialCoordinate(name, -math.pi, math.pi, radius_m, 2.0 * math.pi)


def sample(config: GenerateConfig, streams: RandomStreams) -> SceneObject:
    """Return one sequence of a rope.

    A sequence has one shape and one rope. Its frames are independent draws of that shape, or
    one episode of a hand moving a rope that starts in it.

    Args:
        config: The dataset's config. What its rope settings give as ranges is drawn here.
        streams: The sequence and its random numbers.

    Returns:
        The sequence before it is seen by a camera.

    Raises:
        GenerationError: A shape finds no room under these settings.
    """
    settings = config.rope
    shape = weighted_choice(streams.generator(Stream.ROPE_SHAPE), settings.shapes)
    same_points = bool(settings.drawn)
    settings = draw_proportions(settings, streams.generator(Stream.ROPE_PROPORTIONS))
    body = RopeBody(settings, same_points=same_points)
    roll_limit = math.radians(settings.roll_deg)

    def still(frame: int) -> Pose:
        rng = streams.generator(Stream.ROPE_CONFIGURATION, frame)
        made = sample_configuration(shape, settings, rng)
        roll = rng.uniform(-roll_limit, roll_limit)
        info = {
            "shape": shape,
            "roll_rad": roll,
            "control_points_m": made.control_points.tolist(),
            "handles_m": made.handles.tolist(),
            "attempts": made.attempts,
            **made.detail,
        }
        normal = upward_normal(made.centreline, roll)
        return body.pose(made.centreline, normal, made.ball_centre, info)

    pose = still
    if config.episodes:
        pose = Episode(body, shape, lambda: streams.generator(Stream.ROPE_EPISODE)).pose
    return SceneObject(
        tier=streams.task.tier,
        kind="rope",
        shape=shape,
        temporal=config.episodes,
        frames=config.frames,
        parts=body.parts,
        points=body.points,
        pose=pose,
        size_m=settings.length_m,
        thickness_m=settings.diameter_m,
        info={
            "shape": shape,
            "length_m": settings.length_m,
            "radius_m": settings.radius_m,
            "structure": settings.structure,
            "strands": settings.strands,
            "turns": settings.turns,
            "workspace_m": [extent * settings.length_m for extent in settings.workspace],
            "ball_radius_m": settings.ball_radius_m if settings.ball else None,
        },
    )


def draw_proportions(settings: RopeSettings, rng: np.random.Generator) -> RopeSettings:
    """Return the settings of one rope: each range, in the order of the fields, as a value."""
    values: dict[str, Any] = {}
    for name, (low, high) in settings.drawn.items():
        if isinstance(low, int):
            values[name] = int(rng.integers(low, high + 1))
        else:
            values[name] = float(rng.uniform(low, high))
    return settings.replace(**values) if values else settings
