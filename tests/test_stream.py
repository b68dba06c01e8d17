"""Streamed frames, batches and losses equal those of the written dataset, to the last bit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from torch.utils.data import DataLoader

import pliant
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.generator.seeding import SequenceTask
from pliant.generator.settings import ClothSettings, NoiseSettings
from pliant.generator.simulated import SimulatedDataset, SimulatedFrames, Simulator
from pliant.loaders import AugmentSettings, FrameStore, PairDataset, PairSettings, StepOrder
from pliant.models.don.settings import DonSettings
from pliant.models.don.trainer import train_don
from pliant.spec.configuration import settings_from
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from tests.generator.runner.standin import InProcess
from tests.generator.world import small
from tests.known import known

torch = pytest.importorskip("torch", reason="streams need the extra 'train'")
pytest.importorskip("numba", reason="streams need the extra 'generate'")

SMALL: Any = {"size": (160, 120), "splits": {"train": 2}, "seed": 5}
CLOTH = ClothSettings(points_a_side=33, tracked_a_side=17)
CONFIGS = {
    "configurations": small(
        **{**SMALL, "splits": {"train": 2, "val": 1}}, frames=2, noise=NoiseSettings()
    ),
    "episodes": small(**SMALL, frames=3, episodes=True, gripper=True),
    "cloths": small("cloth-1", **SMALL, cloth=CLOTH),
}
AUGMENTED = settings_from(AugmentSettings, {"rotate_deg": 20})


@pytest.fixture(scope="module")
def config(request: pytest.FixtureRequest) -> GenerateConfig:
    return CONFIGS[request.param]


@pytest.fixture(scope="module")
def written(config: GenerateConfig, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    root = tmp_path_factory.mktemp("written") / "set"
    generate(config, root, engine=InProcess())
    return Dataset.open(root)


@pytest.mark.parametrize("config", CONFIGS, indirect=True)
def test_frames_equal_the_written_ones(config: GenerateConfig, written: Dataset) -> None:
    simulated = SimulatedDataset.of(config)
    assert json.loads(json.dumps(simulated.info)) == written.info
    for mine, theirs in zip(simulated, written, strict=True):
        assert mine.points().equals(theirs.points())
        assert mine.correspondences().equals(theirs.correspondences())
        for frame, other in zip(mine, theirs, strict=True):
            np.testing.assert_array_equal(frame.rgb, other.rgb)
            for name in ("depth_m", "m0", "m1", "object_id"):
                np.testing.assert_array_equal(
                    getattr(known(frame.surface), name), getattr(other.surface, name)
                )
            assert frame.correspondences.equals(other.correspondences)
            np.testing.assert_array_equal(known(frame.camera).K, known(other.camera).K)


@pytest.mark.parametrize(
    ("config", "workers"),
    [
        ("configurations", 0),
        ("configurations", 2),
        ("episodes", 0),
        ("cloths", 0),
        pytest.param("episodes", 2, marks=pytest.mark.long),
        pytest.param("cloths", 2, marks=pytest.mark.long),
    ],
    indirect=["config"],
)
def test_batches_equal_those_of_the_written_set(
    config: GenerateConfig, written: Dataset, workers: int, tmp_path: Path
) -> None:
    settings = PairSettings(queries=12)
    given: Any = {"pairs": settings, "augmentation": AUGMENTED, "size": (80, 60), "seed": 3}
    stream = pliant.stream(config, batch=2, steps=5, cache=tmp_path / "frames", **given)
    batches = list(DataLoader(stream, batch_size=None, num_workers=workers))
    store = FrameStore(written, config.tiers[0], "train", (80, 60))
    samples = PairDataset(store, settings, seed=3, augmentation=AUGMENTED)
    expected = list(DataLoader(samples, batch_sampler=StepOrder(2, 0, 5)))
    assert len(batches) == len(stream) == 5
    for batch, other in zip(batches, expected, strict=True):
        assert batch.keys() == other.keys()
        for name in other:
            torch.testing.assert_close(batch[name], other[name], rtol=0, atol=0)
    later = pliant.stream(config, batch=2, steps=5, start=4, **given)
    torch.testing.assert_close(next(iter(later))["image"], batches[4]["image"], rtol=0, atol=0)


@pytest.mark.parametrize("cached", [True, False])
def test_a_sequence_is_simulated_once(
    cached: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    simulate = Simulator._simulate

    def counted(simulator: Simulator, task: SequenceTask) -> SimulatedFrames:
        made.append(task.id)
        return simulate(simulator, task)

    monkeypatch.setattr(Simulator, "_simulate", counted)
    cache = tmp_path if cached else None
    stream = pliant.stream(CONFIGS["configurations"], batch=4, steps=4, cache=cache)
    list(stream)
    assert sorted(made) == ["rope-train-000000", "rope-train-000001"]


@pytest.mark.long
@pytest.mark.usefixtures("quick_tracing")
def test_training_from_a_config_gives_the_same_losses(tmp_path: Path) -> None:
    generate(CONFIGS["configurations"], tmp_path / "set", engine=InProcess())
    (tmp_path / "rope.yaml").write_text(
        "tiers: [rope]\nsplits: {train: 2, val: 1}\nframes: 2\nnoise: {}\n"
        "width: 160\nheight: 120\nstyle: raster\nseed: 5\n"
    )
    settings = settings_from(
        DonSettings,
        {
            "steps": 4, "batch": 2, "width": 80, "height": 60, "network": {"widths": [8, 32]},
            "validation": {"every": 2, "pairs": 2, "queries": 8, "calibration_pairs": 2},
        },
    )  # fmt: skip
    curves = []
    for data in ("set", "rope.yaml"):
        run = tmp_path / f"run of {data}"
        train_don(pliant.load(tmp_path / data), run, settings)
        state = json.loads(next(run.glob("checkpoints/*/state.json")).read_text())
        curves.append(state["history"])
    assert curves[0] == curves[1]
    assert [entry["step"] for entry in curves[0]] == [2, 4]


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        ({"secret_seed": True, "seed": 0}, {}, "needs a seed"),
        ({"tiers": ("rope", "cloth-1")}, {}, "several tiers"),
        ({}, {"tier": "cloth-1"}, "no such tier"),
        ({}, {"split": "test"}, "no sequence in split 'test'"),
    ],
)
def test_wrong_calls(changes: dict, options: dict, message: str) -> None:
    config = CONFIGS["configurations"].replace(**changes)
    with pytest.raises(CallError, match=message):
        pliant.stream(config, **options)


def test_a_simulated_dataset_has_no_files() -> None:
    simulated = SimulatedDataset.of(CONFIGS["configurations"])
    assert simulated.splits_with_queries() == []
    with pytest.raises(SpecError, match="no files"):
        simulated.files.get("dataset.json")
