"""The real maker: nothing of one sequence, worker or run is left in the next."""

from __future__ import annotations

import json

import pytest

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.generator.settings import (
    AppearanceSettings,
    ClothSettings,
    DepthCameraSettings,
    RopeSettings,
)
from pliant.spec.configuration import settings_from
from pliant.spec.dataset import Dataset
from pliant.spec.errors import GenerationError
from tests.generator.runner.standin import InProcess, digests
from tests.generator.world import made, small


def config(style, count):
    return GenerateConfig(
        tiers=("rope", "cloth-1"),
        splits={"test": count},
        frames=2,
        episodes=style == "raster",
        width=96,
        height=72,
        style=style,
        rope=RopeSettings(knots={"overhand": 1.0}),
        cloth=ClothSettings(points_a_side=25, tracked_a_side=9),
    )


@pytest.mark.parametrize(
    "style",
    [
        pytest.param("raster", marks=pytest.mark.long),
        pytest.param("fast", marks=[pytest.mark.blender, pytest.mark.long]),
    ],
)
def test_grown_by_workers_equals_made_at_once_in_one_process(style, tmp_path):
    if style == "fast":
        pytest.importorskip("bpy")
    generate(config(style, 2), tmp_path / "at-once", engine=InProcess())
    generate(config(style, 1), tmp_path / "grown", engine=InProcess())
    summary = generate(config(style, 2), tmp_path / "grown", workers=2)
    assert summary.made == 2
    assert digests(tmp_path / "grown") == digests(tmp_path / "at-once")


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"noise": {"gaussian": [2.0, 2.0]}}, {"sequence.json", "dataset.json"}),
        (  # the tables name the style
            {"style": "real-depth", "depth_camera": {"specks": [2, 2]}},
            {"sequence.json", "dataset.json", "sequences.parquet"},
        ),
    ],
)
def test_noise_and_the_depth_camera_change_the_colours_alone(changes, named, tmp_path):
    """Their pictures are of the same truth, the same queries and the same cameras."""
    plain = small(frames=2, episodes=True)
    generate(plain, tmp_path / "plain", engine=InProcess())
    dataset = made(plain.replace(**changes), tmp_path / "changed")
    before, after = digests(tmp_path / "plain"), digests(tmp_path / "changed")
    assert before.keys() == after.keys()
    changed = {name.split("/")[-1] for name in before if before[name] != after[name]}
    assert changed == {"000000.png", "000001.png"} | named
    kept, config = dataset.sequences[0].info, dataset.info["provenance"]["config"]
    assert kept["style"] == config["style"]
    assert "bpy" not in kept["tools"]
    assert kept["noise"] == config["noise"]
    assert kept["parameters"].get("depth_camera") == config.get("depth_camera")
    faults = kept["parameters"]["depth_camera"] if "style" in changes else {"specks": [2, 2]}
    assert faults["specks"] == [2, 2]


def test_a_picture_without_anything_is_refused(tmp_path):
    lost = DepthCameraSettings(pinholes=(1.0, 1.0), specks=(0.0, 0.0))
    with pytest.raises(GenerationError, match="the picture has one colour"):
        generate(small(style="real-depth", depth_camera=lost), tmp_path, engine=InProcess())


def test_the_camera_sees_every_configuration_whole(tiny_dataset):
    for sequence in Dataset.open(tiny_dataset).sequences:
        states = set(sequence.correspondences()["visibility"].to_pylist())
        assert "out_of_frame" not in states, sequence.id
        assert "visible" in states


def test_sequences_share_materials_and_another_set_has_others(tmp_path):
    look = AppearanceSettings(materials=1)
    config = small(splits={"train": 2, "test": 1}, look=look)
    other_look = config.replace(look=look.replace(first_material=1))
    generate(config, tmp_path / "seen", engine=InProcess())
    generate(other_look, tmp_path / "unseen", engine=InProcess())
    seen, unseen = (
        [s.info["parameters"]["look"] for s in Dataset.open(tmp_path / name).sequences]
        for name in ("seen", "unseen")
    )
    lights = [appearance.pop("light") for appearance in seen]
    assert seen[0] == seen[1] == seen[2]
    assert lights[0] != lights[1]
    assert lights == [appearance.pop("light") for appearance in unseen]
    assert unseen[0] == unseen[1] != seen[0]
    for name in ("points", "correspondences"):
        first = Dataset.open(tmp_path / "seen").sequences[0]
        other = Dataset.open(tmp_path / "unseen").sequences[0]
        assert getattr(first, name)().equals(getattr(other, name)())


def test_a_dataset_says_how_to_make_it_again(tmp_path):
    """From `provenance.config` alone, whatever order its keys were given in."""
    shapes = {"open": 1.0, "loop": 1.0, "knot": 1.0, "overlap": 1.0}
    rope = RopeSettings(shapes=shapes, knots={"figure-eight": 1.0, "overhand": 1.0})
    given = small(splits={"test": 4}, seed=3, rope=rope)
    generate(given, tmp_path / "first", engine=InProcess())
    document = json.loads((tmp_path / "first" / "dataset.json").read_text())
    again = settings_from(GenerateConfig, document["provenance"]["config"])
    generate(again, tmp_path / "again", engine=InProcess())
    first, second = digests(tmp_path / "first"), digests(tmp_path / "again")
    differing = {name for name in first if first[name] != second[name]}
    assert first.keys() == second.keys()
    assert differing <= {"dataset.json"}  # it holds the config as it was given
