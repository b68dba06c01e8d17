"""The cloth: a mass-and-spring simulator and its tiers."""

from pliant.generator.objects.cloth.sampling import cloth_tier, sample_cloth
from pliant.generator.settings.cloth import ClothSettings

__all__ = ["ClothSettings", "cloth_tier", "sample_cloth"]
