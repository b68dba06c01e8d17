"""Ropes: shapes, knots, geometry, material points and episodes."""

from pliant.generator.rope.sampler import sample_rope
from pliant.generator.rope.settings import RopeSettings
from pliant.generator.rope.tier import rope_tier

__all__ = ["RopeSettings", "rope_tier", "sample_rope"]
