"""Datasets of random settings are right: `validate` finds nothing in them.

It compares cameras, depth, surfaces, points, queries, truth and boxes with each other, by code that
shares nothing with the generator.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.spec.configuration import settings_from
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


UNUSUAL: dict[str, dict[str, Any]] = {
    "edge-on-and-far": {
        "tiers": ["cloth-1"], "frames": 2, "width": 160, "height": 120, "seed": 3677538242703185448,
        "cloth": {
            "points_a_side": 33, "doublings": 0, "tracked_a_side": 9, "proportion": 0.4,
            "coverage_band": [0, 1.2],
        },
        "camera": {
            "distance_m": [5, 5], "top": 0, "oblique_elevation_deg": [10, 10],
            "fov_deg": [120, 120],
        },
        "scene": {"distractors": [4, 4], "distractor_over": 0},
    },
    "wrinkles-below-a-pixel": {
        "tiers": ["cloth-2"], "frames": 2, "width": 32, "height": 24, "seed": 5,
        "cloth": {"points_a_side": 65, "tracked_a_side": 65},
    },
}  # fmt: skip
"""Name -> settings of cloths that pixel centres miss in part."""


@pytest.mark.parametrize("name", UNUSUAL)
def test_unusual_dataset(name: str, tmp_path: Path) -> None:
    base = {"splits": {"test": 2}, "style": "raster", "queries": {"queries_per_pair": 8}}
    config = settings_from(GenerateConfig, base | UNUSUAL[name])
    summary = generate(config, tmp_path / "data", engine=InProcess())
    assert not summary.failed
    assert validate(tmp_path / "data").issues == []
