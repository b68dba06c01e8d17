"""Ropes: shapes, knots, geometry, material points and episodes."""

from pliant.generator.objects.rope.sampler import rope_tier, sample_rope
from pliant.generator.settings.rope import RopeSettings

__all__ = ["RopeSettings", "rope_tier", "sample_rope"]
