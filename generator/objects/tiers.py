"""The tiers by name: what each declares in `dataset.json`, and how its scene objects are drawn."""

from __future__ import annotations

from pliant.generator.config import TIER_KINDS, GenerateConfig
from pliant.generator.scene.scene_object import SceneObject
from pliant.generator.seeding import RandomStreams, SequenceTask
from pliant.spec.model import Tier


def describe_tier(config: GenerateConfig, tier: str) -> Tier:
    """Return a tier's objects, material coordinates and symmetries.

    Args:
        config: The dataset's config.
        tier: One of `TIER_KINDS`.
    """
    if TIER_KINDS[tier] == "rope":
        from pliant.generator.objects.rope import rope_tier

        return rope_tier(config.rope, tier)
    from pliant.generator.objects.cloth import cloth_tier

    return cloth_tier(config.cloth, tier)


def sample_scene_object(config: GenerateConfig, task: SequenceTask) -> SceneObject:
    """Draw the object of one sequence; it depends on config and task alone.

    Args:
        config: The dataset's config.
        task: Which sequence.

    Raises:
        GenerationError: No acceptable configuration was found.
    """
    streams = RandomStreams(config.seed, task)
    if TIER_KINDS[task.tier] == "rope":
        from pliant.generator.objects.rope import sample_rope

        return sample_rope(config.rope, streams, config.frames, temporal=config.episodes)
    from pliant.generator.objects.cloth import sample_cloth

    return sample_cloth(config.cloth, streams, config.frames, temporal=config.episodes)
