"""A new tier needs one module: a dataset of the example's coils is valid and has queries."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from pliant.generator.config import TIER_KINDS
from pliant.generator.objects.tiers import TIER_MODULES
from pliant.generator.settings import RopeSettings
from tests.generator.world import made, small

EXAMPLE = Path(__file__).with_name("coil_tier.py")


def test_a_tier_of_one_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLE.parent))
    monkeypatch.delitem(sys.modules, "coil_tier", raising=False)
    monkeypatch.setitem(TIER_KINDS, "rope-coil", "rope")
    monkeypatch.setitem(TIER_MODULES, "rope-coil", "coil_tier")
    config = small("rope-coil", (160, 120), rope=RopeSettings(ball=False))
    dataset = made(config, tmp_path / "coils")
    sequence = dataset.sequence("rope-coil-test-000000")
    assert sequence.shape == "coil"
    assert (sequence.surface(0).object_id == 1).mean() > 0.05
    states = np.array(sequence.correspondences(0)["visibility"].to_pylist())
    assert 0.3 < (states == "visible").mean() < 0.9
    assert len(dataset.queries("test")) > 50
