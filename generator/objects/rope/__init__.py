"""Ropes: shapes, knots, geometry, material points and episodes."""

from pliant.generator.objects.rope.sampler import sample_rope
from pliant.generator.objects.rope.tier import rope_tier
from pliant.generator.settings.rope import RopeSettings

__all__ = ["RopeSettings", "rope_tier", "sample_rope"]
