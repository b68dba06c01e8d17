"""Configs of the reference benchmark, the shipped ones and wrong ones, and its frozen queries."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from pliant.benchmarks.suite.checksums import read_frozen
from pliant.benchmarks.suite.config_file import read_config
from pliant.benchmarks.suite.run import run_digest
from pliant.generator.runner.run import generate
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.reading import sha256_file
from tests.benchmarks.conftest import BENCHMARKS, THUMB
from tests.generator.runner.standin import InProcess
from tests.known import known


@pytest.mark.parametrize("name", ["pliant-v3", "pliant-v3-mini"])
def test_the_shipped_benchmarks_can_be_read_and_trained(name: str) -> None:
    from pliant.models.don.settings import DonSettings
    from pliant.models.timecycle.settings import TimeCycleSettings
    from pliant.spec.configuration import settings_from

    config = read_config(BENCHMARKS / f"{name}.yaml")
    assert config.name == name
    for training in config.runs.values():
        cls = DonSettings if training.trainer == "don" else TimeCycleSettings
        settings_from(cls, training.settings)  # refuses what it does not know
    for test in config.tests.values():
        assert {config.sets[each].tiers for each in test.variants.values()} == {(test.tier,)}
        assert test.tracks[0] == "none"  # the headline


@pytest.mark.parametrize(
    ("name", "ropes", "cloths"), [("pliant-v3", 200, 100), ("pliant-v3-mini", 60, 40)]
)
def test_what_the_benchmark_asks(name: str, ropes: int, cloths: int) -> None:
    config = read_config(BENCHMARKS / f"{name}.yaml")
    for key, made in config.asked.items():
        low, high = made.look.object_hue
        assert 0.5 <= low < high <= 0.75  # trainings' hues begin at -0.25, which is 0.75
        assert set(made.look.rope_colourings) == {"two-tone"}
        if made.episodes:
            assert made.gripper
            assert made.queries.moving_share >= 0.5
            assert made.counts["test"] >= 24
        elif made.style != "photo":
            assert made.counts["test"] >= (ropes if "rope" in made.tiers else cloths)
        if key in ("cloth-2", "towel"):
            assert made.cloth.sides == "alternate"
        if "rope" in made.tiers and not made.episodes:
            assert made.camera.fov_deg[1] - made.camera.fov_deg[0] >= 30
    assert [made.style for made in config.asked.values()].count("photo") == 1
    for test in config.tests.values():
        assert {"identity", "centroid"} <= set(test.methods)
    paper = [test for test in config.tests.values() if test.paper_rmse_px]
    assert [test.tier for test in paper] == ["rope", "cloth-1", "cloth-3"]
    assert all(set(test.methods) >= {"sift", "surf", "orb"} for test in paper)
    learned = (*paper[0].runs, "don-rope")
    blank = [(each.method, each.track) for each in paper[0].entries if each.is_blank]
    assert blank == [(method, track) for track in ("segmenter", "given") for method in learned]
    for test in paper:
        trained = [f"{test.tier}-{loss}" for loss in ("contrastive", "distributional")]
        assert list(test.runs) == [
            one for run in trained if name == "pliant-v3-mini" for one in config.members(run)
        ]
        if name == "pliant-v3-mini":
            assert len(test.runs) == 6  # three seeds stand behind a verdict


def test_variants_of_one_camera_ask_the_same_queries() -> None:
    sets = read_config(BENCHMARKS / "pliant-v3-mini.yaml").sets
    for tier in ("rope", "cloth-1"):
        same, each = sets[tier], sets[f"{tier}-noisy"]
        assert same == each.replace(noise=None, id=same.id, title=same.title)


@pytest.mark.parametrize(
    ("name", "variant"),
    [
        ("pliant-v3-mini", "rope"),
        pytest.param("pliant-v3-mini", "cloth-3", marks=pytest.mark.long),
        pytest.param("pliant-v3-mini", "towel", marks=pytest.mark.long),
    ],
)
def test_a_regenerated_sequence_is_the_frozen_one(name: str, variant: str, tmp_path: Path) -> None:
    config = read_config(BENCHMARKS / f"{name}.yaml")
    frozen = known(read_frozen(config))
    few = config.sets[variant].replace(splits={"test": 1}, sequences=None)
    generate(few, tmp_path / "set", engine=InProcess())
    for sequence in Dataset.open(tmp_path / "set").sequences:
        table = sequence.dir / "correspondences.parquet"
        assert sha256_file(table) == frozen["sets"][variant]["tables"][sequence.id]


RUN = {"label": "A", "set": "rope"}
COMPARISON = {"question": "Q", "set": "rope", "method": "sift", "against": "identity"}
TEST = {"title": "T", "tier": "rope", "variants": {"clean": "rope"}}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unknown": 1}, "unknown setting"),
        ({"runs": {"a": {"label": "A", "set": "none"}}}, "unknown name"),
        ({"runs": {"a": {"label": "A"}}}, "a setting is missing"),
        ({"runs": {"a": {"label": "A", "set": "rope", "recipe": "x.yaml"}}}, "unknown name"),
        ({"runs": {"a": {"label": "A", "set": "rope", "trainer": "x"}}}, "unknown value"),
        ({"tests": {"t": {**TEST, "tracks": ["masks"]}}}, "unknown value"),
        ({"tests": {"t": {**TEST, "paper_rmse_px": {"sfit": 1.0}}}}, "unknown name"),
        ({"tests": {"t": {**TEST, "shipped": ["fused:sift"]}}}, "unknown name"),
        ({"sets": {"rope": {"tiers": ["rope"], "style": "oil"}}}, "style"),
        ({"sets": []}, "required: a mapping"),
        ({"sets": {"../rope": {"id": "a", "tiers": ["rope"]}}}, r"sets\.\.\./rope.*1 to 128 of"),
        ({"runs": {"a/b": {"label": "A", "set": "rope"}}}, "runs.a/b.*1 to 128 of"),
        ({"tests": {"t": {**TEST, "variants": {"a": "b"}}}}, "unknown name"),
        ({"tests": {"t": {**TEST, "figures": ["rms"]}}}, "unknown name"),
        ({"tests": {"t": {**TEST, "protocols": ["paper", "tapvit"]}}}, "t.protocols: .*'tapvid'"),
        ({"tests": {"t": {**TEST, "protocols": []}}}, "t.protocols: .*required: not empty"),
        ({"runs": {"a": {**RUN, "settings": {"stepz": 3}}}}, "a.settings.stepz: .*'steps'"),
        ({"runs": {"a": {**RUN, "settings": {"seed": "x"}}}}, "a.settings.seed: .*wrong type"),
        (
            {
                "tests": {"t": {**TEST, "methods": ["sift", "identity"]}},
                "comparisons": [{**COMPARISON, "metric": "rmse"}],
            },
            "comparisons.0.metric: unknown name; found rmse",
        ),
        ({"tests": {"t": {**TEST, "answer": {"rotation": 2}}}}, "t.answer.rotation: .*'rotations'"),
        ({"tests": {"t": {**TEST, "tier": "roope"}}}, "t.tier: .*roope.*Did you mean 'rope'"),
        (
            {"sets": {"rope": {"tiers": ["rope"], "splits": {"val": 3}}}, "tests": {"t": TEST}},
            "sets.rope.splits: the set has no test split",
        ),
    ],
)
def test_a_wrong_config_is_refused(change: dict[str, object], message: str, tmp_path: Path) -> None:
    document = {
        **yaml.safe_load(THUMB.read_text()),
        "tests": {},
        "runs": {},
        "comparisons": [],
        **change,
    }
    path = tmp_path / "wrong.yaml"
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(CallError, match=message) as refusal:
        read_config(path)
    assert "wrong.yaml" in str(refusal.value)


def test_a_training_is_another_when_its_settings_are(config_file: Path) -> None:
    config = read_config(config_file)
    changed = {**config.runs, "small": config.runs["small"].replace(settings={"steps": 5})}
    other = config.replace(runs=changed)
    assert run_digest(config, "small") != run_digest(other, "small")
    assert run_digest(config, "small") == run_digest(read_config(config_file), "small")
