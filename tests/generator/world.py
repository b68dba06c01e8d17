"""What several tests make: the object of a sequence, and datasets in which nothing is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.tiers import sample_scene_object
from pliant.generator.runner.run import generate
from pliant.generator.scene.scene_object import SceneObject
from pliant.generator.seeding import SequenceTask
from pliant.spec.dataset import Dataset
from pliant.spec.validation.validate import validate
from tests.generator.runner.standin import InProcess


def scene(
    tier: str, *, seed: int = 0, split: str = "train", index: int = 0, **fields: Any
) -> SceneObject:
    """Return a sequence before it is seen by a camera.

    Args:
        tier: Its tier.
        seed: The dataset's seed.
        split: Its split.
        index: Its number.
        fields: Other fields of the dataset's config.
    """
    config = GenerateConfig(tiers=(tier,), seed=seed, **fields)
    return sample_scene_object(config, SequenceTask(tier, split, index))


def made(config: GenerateConfig, root: Path) -> Dataset:
    """Return a dataset generated in this process, in which validation finds nothing."""
    summary = generate(config, root, engine=InProcess())
    assert not summary.failed, summary.failed[0].error
    report = validate(root)
    assert (report.errors, list(report.issues)) == (0, [])
    return Dataset.open(root)
