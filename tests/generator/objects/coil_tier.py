"""An example of a new tier of an existing kind: a rope that lies in a flat coil.

A tier is a module with two functions. `describe` returns what `dataset.json` declares; `sample`
returns a `SceneObject`: parts, named points, and the geometry of each frame. Truth, cameras,
styles, tables and queries need nothing else. `test_scenes.py` registers this one and makes a
dataset of it.
"""

from __future__ import annotations

import math

import numpy as np

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.rope import sampler
from pliant.generator.objects.rope.body import RopeBody, upward_normal
from pliant.generator.objects.rope.curve import arc_length, resample
from pliant.generator.scene.scene_object import Pose, SceneObject
from pliant.generator.seeding import RandomStreams, Stream
from pliant.spec.model import Tier


def describe(config: GenerateConfig, tier: str) -> Tier:
    """Return the material of the rope: the coil changes its shape alone."""
    return sampler.describe(config, tier)


def sample(config: GenerateConfig, streams: RandomStreams) -> SceneObject:
    """Draw a sequence whose frames are independent coils; the rope must have no ball."""
    settings = config.rope
    body = RopeBody(settings)

    def pose(frame: int) -> Pose:
        rng = streams.generator(Stream.ROPE_CONFIGURATION, frame)
        turns = rng.uniform(1.5, 2.5)
        phi = np.linspace(0.0, 2.0 * math.pi * turns, 4000)
        radius = 1.0 + phi * rng.uniform(0.12, 0.2)
        line = np.stack([radius * np.cos(phi), radius * np.sin(phi), np.zeros(len(phi))], axis=1)
        line *= settings.length_m / arc_length(line)[-1]
        line[:, 2] = settings.radius_m  # on the table
        centreline = resample(line, settings.rows)
        return body.pose(centreline, upward_normal(centreline, 0.0), None, {"turns": turns})

    return SceneObject(
        tier=streams.task.tier,
        kind="rope",
        shape="coil",
        temporal=False,
        frames=config.frames,
        parts=body.parts,
        points=body.points,
        pose=pose,
        size_m=settings.length_m,
        thickness_m=settings.diameter_m,
    )
