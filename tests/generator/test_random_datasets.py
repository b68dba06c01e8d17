"""Datasets of random settings are right: `validate` finds nothing in them.

It compares cameras, depth, surfaces, points, queries, truth and boxes with each other, by code that
shares nothing with the generator.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")

from pliant.generator.runner.run import generate
from pliant.spec.dataset import Dataset
from pliant.spec.validation.validate import validate
from tests.generator.random_settings import draw_config
from tests.generator.runner.standin import InProcess

SETS = int(os.environ.get("PLIANT_RANDOM_SETS", "500"))


def check(number: int, out: Path, *styles: str) -> None:
    config = draw_config(np.random.default_rng(number), *styles)
    summary = generate(config, out, engine=InProcess())
    assert not summary.failed, summary.failed[0].error
    report = validate(out)
    assert not report.errors, report.issues[:3]
    assert len(Dataset.open(out).sequences) == len(config.tiers) * sum(config.counts.values())


@pytest.mark.parametrize("number", [*range(8), 375, 430])  # the last two have sharp folds
def test_random_dataset(number: int, tmp_path: Path) -> None:
    check(number, tmp_path / "data", "raster", "real-depth")


@pytest.mark.long
@pytest.mark.parametrize("number", range(8, SETS))
def test_many_random_datasets(number: int, tmp_path: Path) -> None:
    check(number, tmp_path / "data", "raster", "real-depth")
