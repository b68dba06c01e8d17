"""The tiers by name: what each declares in `dataset.json`, and how its scene objects are drawn.

To add a tier, write a module with `describe` and `sample`, and name it in `TIER_MODULES` and in
`pliant.generator.config.TIER_KINDS`. `tests/generator/objects/coil_tier.py` is an example.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from typing import Final, Protocol, cast

from pliant.generator.config import TIER_KINDS, GenerateConfig
from pliant.generator.objects import distractors, gripper
from pliant.generator.scene.scene_object import GRIPPER, SceneObject
from pliant.generator.seeding import RandomStreams, SequenceTask, Stream
from pliant.spec.errors import MissingExtraError
from pliant.spec.model import DISTRACTOR, MaterialCoordinate, MaterialObject, Tier

TIER_MODULES: Final[dict[str, str]] = {
    "rope": "pliant.generator.objects.rope.sampler",
    "cloth": "pliant.generator.objects.cloth.sampling",
}
"""Module of a tier, or of all tiers of a kind."""


class TierModule(Protocol):
    """The functions of a tier's module."""

    def describe(self, config: GenerateConfig, tier: str) -> Tier:
        """Return the tier's objects, material coordinates and symmetries."""

    def sample(self, config: GenerateConfig, streams: RandomStreams) -> SceneObject:
        """Draw the object of one sequence.

        Raises:
            GenerationError: No acceptable configuration was found.
        """


def describe_tier(config: GenerateConfig, tier: str) -> Tier:
    """Return a tier's objects, material coordinates and symmetries.

    Args:
        config: The dataset's config.
        tier: One of `TIER_KINDS`.
    """
    described = _module(tier).describe(config, tier)
    if config.gripper:
        described = _with_scenery(described, [GRIPPER], ("height", "across"), gripper.EXTENT_M)
    names = [f"{DISTRACTOR}-{k + 1}" for k in range(config.scene.distractors[1])]
    return _with_scenery(described, names, ("along", "across"), distractors.EXTENT_M)


def _with_scenery(tier: Tier, names: Sequence[str], axes: tuple[str, str], extent_m: float) -> Tier:
    """Return a tier whose scenes also show objects about which nothing is asked: the last ones."""
    first, second = (MaterialCoordinate(axis, 0.0, 1.0, extent_m) for axis in axes)
    number = max(each.id for each in tier.objects) + 1
    added = (MaterialObject(number + k, name, (first, second)) for k, name in enumerate(names))
    return replace(tier, objects=(*tier.objects, *added))


def sample_scene_object(config: GenerateConfig, task: SequenceTask) -> SceneObject:
    """Draw the object of one sequence; it depends on config and task alone.

    Args:
        config: The dataset's config.
        task: Which sequence.

    Raises:
        GenerationError: No acceptable configuration was found.
    """
    streams = RandomStreams(config.seed, task)
    sampled = _module(task.tier).sample(config, streams)
    if config.scene.distractors[1]:  # never in episodes, nor with a gripper
        return distractors.add_distractors(sampled, streams, config.scene)
    if config.gripper:
        return gripper.add_gripper(sampled, streams.generator(Stream.GRIPPER))
    return sampled


def _module(tier: str) -> TierModule:
    name = TIER_MODULES.get(tier) or TIER_MODULES[TIER_KINDS[tier]]
    try:
        return cast(TierModule, import_module(name))
    except ImportError as error:
        raise MissingExtraError(f"tier {tier}", "generate") from error
