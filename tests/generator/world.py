"""What several tests make: the object of a sequence, and datasets in which nothing is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.tiers import sample_scene_object
from pliant.generator.runner.run import generate
from pliant.generator.scene.scene_object import SceneObject
from pliant.generator.seeding import SequenceTask
from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.sequence import SequenceRecord
from pliant.spec.validation.validate import validate
from tests.generator.runner.standin import InProcess


def small(tier: str = "rope", size: tuple[int, int] = (96, 72), **fields: Any) -> GenerateConfig:
    """Return a config of small images that need no Blender, with other fields of a config."""
    width, height = size
    values = {"splits": {"test": 2}, "style": "raster", **fields}
    return GenerateConfig(tiers=(tier,), width=width, height=height, **values)


def srgb_curve(linear: FloatArray) -> FloatArray:
    """Return linear light (0 to 1) as sRGB, by the standard's formula."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def newly_hidden(sequence: SequenceRecord, alone: SequenceRecord, frame: int) -> int:
    """Return how many points something hides that only one of two equal sequences has.

    That is all that it may change in their tables.
    """
    here, there = sequence.correspondences(frame), alone.correspondences(frame)
    for column in set(here.column_names) - {"visibility"}:
        np.testing.assert_array_equal(here[column], there[column])
    after, before = (np.array(each["visibility"].to_pylist()) for each in (here, there))
    assert set(after[before != after]) <= {"occluded"}
    assert set(sequence.points()["object"].to_pylist()) == {1}
    return int((before != after).sum())


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
