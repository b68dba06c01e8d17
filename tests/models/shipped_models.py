"""Shipped models, and datasets with the looks of what they were trained on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.models import shipped
from pliant.models.don.matcher import DonMatcher
from pliant.models.shipped import load_shipped
from pliant.spec.configuration import merged, read_mapping, settings_from
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Pair
from tests.generator.runner.standin import InProcess


def shipped_don(name: str, **options: Any) -> DonMatcher:
    matcher = load_shipped(name, **options)
    assert isinstance(matcher, DonMatcher)
    return matcher


def made_like_training_set(name: str, folder: Path, sequences: int, **changes: Any) -> Dataset:
    """Return a test split with the looks of a model's training set, with some changes."""
    trained_on = read_mapping(shipped.FOLDER / name / "data.yaml")
    few = {**trained_on, "splits": {"test": sequences}, "sequences": None}
    generate(settings_from(GenerateConfig, merged(few, changes)), folder, engine=InProcess())
    return Dataset.open(folder)


def smooth_cloths(folder: Path, **cloth: Any) -> list[Pair]:
    """Two pairs of smooth cloths seen from above, with the looks of training."""
    dataset = made_like_training_set(
        "don-cloth",
        folder,
        3,
        tiers=["cloth-1"],
        seed=79,
        camera={"top": 1.0, "oblique": 0.0, "shift": [0.0, 0.0]},
        cloth={"yaw_max_rad": 0.1, **cloth},
    )
    return [pair.seen() for pair in dataset.pairs("test")[:2]]
