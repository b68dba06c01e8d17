"""A frame depends on its key alone, whatever was asked for before; a tier needs one module."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import numpy as np
import pytest

from pliant.generator.config import TIER_KINDS
from pliant.generator.objects.tiers import TIER_MODULES
from pliant.generator.scene.scene_object import Pose
from pliant.generator.settings import ClothSettings, RopeSettings
from tests.generator.world import made, scene, small

CLOTH = ClothSettings(points_a_side=33)


def digest(pose: Pose) -> str:
    out = hashlib.sha256()
    for name in sorted(pose.vertices):
        out.update(pose.vertices[name].tobytes())
    if pose.centreline is not None:
        out.update(pose.centreline.tobytes())
    out.update(repr(pose.info).encode())
    return out.hexdigest()


@pytest.mark.parametrize("tier", ["rope", "cloth-1"])
@pytest.mark.parametrize("episodes", [True, False])
def test_a_frame_depends_on_its_key_alone(tier: str, episodes: bool) -> None:
    first = scene(tier, frames=12, episodes=episodes, cloth=CLOTH)
    frames = {frame: digest(first.pose(frame)) for frame in (0, 1, 9 if episodes else 2)}
    assert len(set(frames.values())) == 3
    other = scene(tier, frames=3000, episodes=episodes, cloth=CLOTH)
    other.pose(11 if episodes else 3)
    for frame in sorted(frames, reverse=True):  # going back
        assert digest(other.pose(frame)) == frames[frame]
        assert digest(other.pose(frame)) == frames[frame]
    for change in ({"seed": 1}, {"split": "test"}, {"index": 1}):
        changed = scene(tier, frames=12, episodes=episodes, cloth=CLOTH, **change)
        assert digest(changed.pose(0)) != frames[0]


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
