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


QUICK = [*range(8), 375, 430]  # the last two have sharp folds
LONG = [pytest.param(each, marks=pytest.mark.long) for each in range(SETS) if each not in QUICK]


@pytest.mark.parametrize("number", [*QUICK, *LONG])
def test_random_dataset(number: int, tmp_path: Path) -> None:
    out = tmp_path / "data"
    config = draw_config(np.random.default_rng(number))
    summary = generate(config, out, engine=InProcess())
    assert not summary.failed, summary.failed[0].error
    report = validate(out)
    assert not report.errors, report.issues[:3]
    assert len(Dataset.open(out).sequences) == len(config.tiers) * sum(config.counts.values())
