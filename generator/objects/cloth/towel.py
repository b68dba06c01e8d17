"""The tier `towel`: a cloth with a hem and two unequal stripes, in any orientation.

A wide stripe is near one end and a narrow one along one side. Both faces show them, in exchanged
colours as a woven pattern has them. Seen from the back they are a mirror image, so the picture says
which face is up whatever the colours are: every point has one answer, however the towel is placed.
"""

from __future__ import annotations

import math
from dataclasses import replace

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.cloth.sampling import cloth_tier, sample_cloth
from pliant.generator.scene.scene_object import SceneObject
from pliant.generator.seeding import RandomStreams
from pliant.generator.settings.cloth import ClothSettings
from pliant.spec.model import Tier


def describe(config: GenerateConfig, tier: str) -> Tier:
    """Return the towel tier of a dataset: no symmetries."""
    return cloth_tier(_towel(config.cloth), tier)


def sample(config: GenerateConfig, streams: RandomStreams) -> SceneObject:
    """Draw one sequence of a dataset's towel tier."""
    return sample_cloth(_towel(config.cloth), streams, config.frames, temporal=config.episodes)


def _towel(settings: ClothSettings) -> ClothSettings:
    """Return a towel's settings: level 2 unless one is given, turned by any angle."""
    return replace(settings, variant="towel", level=settings.level or 2, yaw_max_rad=math.pi)
