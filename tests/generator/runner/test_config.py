from __future__ import annotations

import json

import pytest

from pliant.generator.config import GenerateConfig, QuerySettings, split_counts
from pliant.generator.runner.plan import plan_tasks
from pliant.generator.settings import RopeSettings
from pliant.spec.configuration import read_settings, settings_from
from pliant.spec.errors import CallError
from pliant.spec.io.yamlfiles import yaml_text


def test_round_trip_through_yaml_and_json(tmp_path):
    config = GenerateConfig(
        tiers=("cloth-1", "rope"),
        splits={"test": 2, "train": 5},
        frames=7,
        episodes=True,
        seed=0,
        rope=RopeSettings(length_m=1.0),
        queries=QuerySettings(queries_per_pair=9, splits=("test",)),
    )
    (tmp_path / "c.yaml").write_text(yaml_text(config.to_dict()))
    (tmp_path / "c.json").write_text(json.dumps(config.to_dict()))
    assert read_settings(GenerateConfig, tmp_path / "c.yaml") == config
    assert read_settings(GenerateConfig, tmp_path / "c.json") == config
    assert config.tiers == ("rope", "cloth-1")
    assert list(config.counts) == ["train", "test"]


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"tiers": ["ropes"]}, "tiers"),
        ({"tiers": ["rope"], "camera": {"top": 0.0, "oblique": 0.0}}, "camera.top"),
        ({"tiers": ["rope"], "look": {"tables": {"wood": 0.0}}}, "look.tables"),
        ({"tiers": ["rope"], "episodes": True}, "frames"),
        ({"tiers": ["rope"], "sequences": 3, "splits": {"test": 3}}, "sequences"),
        ({"tiers": ["rope"], "splits": {"dev": 3}}, "splits"),
        ({"tiers": ["rope"], "splits": {}}, "splits"),
    ],
)
def test_refuses_and_names_the_field(values, named):
    with pytest.raises(CallError, match=named):
        settings_from(GenerateConfig, values)


def test_the_depth_camera_belongs_to_its_style():
    values = {"tiers": ["rope"], "style": "real-depth"}
    assert "depth_camera" not in GenerateConfig(tiers=("rope",)).resolved()
    plain = settings_from(GenerateConfig, values)
    assert plain.to_dict()["depth_camera"] is None
    filled = plain.resolved()
    assert filled["depth_camera"]["table_grey"] == [142.0, 154.0]
    assert settings_from(GenerateConfig, filled).resolved() == filled
    with pytest.raises(CallError, match=r"depth_camera\.holes: unknown setting"):
        settings_from(GenerateConfig, {**values, "depth_camera": {"holes": 3}})
    with pytest.raises(CallError, match=r"style.*found \"raster\"; required: real-depth"):
        settings_from(GenerateConfig, {**values, "style": "raster", "depth_camera": {}})


def test_splits_never_shrink_as_a_set_grows():
    before = {"train": 0, "val": 0, "test": 0}
    for count in range(1, 60):
        now = {**dict.fromkeys(before, 0), **split_counts(count)}
        assert sum(now.values()) == count
        assert all(now[split] >= before[split] for split in before)
        before = now
    assert split_counts(10) == {"train": 7, "val": 1, "test": 2}


def test_a_larger_plan_holds_the_smaller_one():
    small = plan_tasks(GenerateConfig(tiers=("rope",), sequences=13))
    large = plan_tasks(GenerateConfig(tiers=("rope", "cloth-3"), sequences=57))
    assert set(small) < set(large)
    assert len({task.id for task in large}) == len(large) == 2 * 57
