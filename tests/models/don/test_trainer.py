from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest
import torch

from pliant.loaders.frame_store import FrameStore
from pliant.models.don.loading import load_matcher
from pliant.models.don.settings import AnswerSettings, DonSettings
from pliant.models.don.trainer import train_don
from pliant.models.don.validation import draw_validation_pairs
from pliant.models.training.checkpoint import latest_checkpoint, read_weights_file
from pliant.models.training.optimiser import learning_rate
from pliant.models.training.processes import Processes
from pliant.models.training.run_folder import open_run
from pliant.models.training.settings import OptimiserSettings
from pliant.spec.configuration import read_settings, settings_to_dict
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, TrainingError
from tests.known import known
from tests.loaders.sheet_dataset import write_sheet_dataset
from tests.models.tiny_runs import DON, don, last_checkpoint, options, train_two_steps


@pytest.mark.long
def test_overfits_four_pairs(sheet_dataset: Dataset, tmp_path: Path) -> None:
    """Four frames, any two of them a pair: to be found to a fraction of a pixel."""
    settings = don(
        "steps=70",
        "batch=2",
        "width=80",
        "height=60",
        "network.widths=[16, 32, 32]",
        "network.descriptor_dim=8",
        "pairs.queries=32",
        "augment={rotate_deg: 0, scale: 0, colour: 0, noise: 0}",
        "validation={split: train, every: 70, pairs: 12, queries: 64, calibration_pairs: 2}",
        "optimiser.warmup=10",
        "checkpoint_every=70",
    )
    facts = train_don(sheet_dataset, tmp_path / "run", settings)
    assert facts["validation"]["rmse_px"] < 1.5  # 3 is asked for


def test_a_run_interrupted_before_its_first_checkpoint_begins_again(
    sheet_dataset: Dataset, tmp_path: Path
) -> None:
    """It has no checkpoint to resume; its folder is not that of something else either."""
    run = tmp_path / "run"

    def stop(*_: object) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        train_don(sheet_dataset, run, don(), progress=stop)
    with pytest.raises(TrainingError, match=r"no checkpoint to resume.*Start it without --resume"):
        train_don(sheet_dataset, run, don(), resume=True)
    with open_run(run, don(), False, "decode"), pytest.raises(CallError, match="another process"):
        train_don(sheet_dataset, run, don())
    train_two_steps(train_don, sheet_dataset, run, don())
    assert len(list((run / "tensorboard").iterdir())) == 1
    with pytest.raises(CallError, match="must be empty"):
        train_don(sheet_dataset, run, don())


def test_a_run_goes_on_with_its_own_data_and_as_many_processes(
    sheet_dataset: Dataset, tmp_path: Path
) -> None:
    """Another dataset of the same id and version is other data.

    A step takes a batch for each process: with fewer, samples would be seen twice.
    """
    other = Dataset.open(write_sheet_dataset(tmp_path / "set", {"train": 2, "val": 3}))
    assert other.id == sheet_dataset.id
    run = tmp_path / "run"
    train_two_steps(train_don, sheet_dataset, run, don())
    with pytest.raises(TrainingError, match="run: a run resumes only with the datasets"):
        train_don(other, run, don(), resume=True)
    state = known(latest_checkpoint(run)) / "state.json"
    state.write_text(json.dumps(json.loads(state.read_text()) | {"processes": 2}))
    with pytest.raises(TrainingError, match=r"as many processes .*required: 2"):
        train_don(sheet_dataset, run, don(), resume=True)


@pytest.mark.parametrize("rank", [0, 1])
def test_processes_write_after_the_first_one_opened_the_run(
    sheet_dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rank: int
) -> None:
    """Process 0 refuses a folder that is not empty, and process 1 then leaves it as it is."""
    said: list[float] = []

    def refused(value: float, _: Processes) -> float:
        said.append(value)
        return 0.0

    one_of_two = nullcontext(Processes(rank, 2, torch.device("cpu")))
    monkeypatch.setattr("pliant.models.training.loop.joined_processes", lambda: one_of_two)
    monkeypatch.setattr("pliant.models.training.loop.agree", refused)
    (tmp_path / "notes.txt").write_text("mine")
    error, message = [(CallError, "must be empty"), (TrainingError, "process 0 could not open")][
        rank
    ]
    with pytest.raises(error, match=message):
        train_don(sheet_dataset, tmp_path, don())
    assert said == [rank]
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("keep", ["best", "last"])
def test_which_weights_answer(
    sheet_dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keep: str
) -> None:
    """Validation finds the weights of step 3 better than those of step 6."""
    found = iter([1.0, 2.0, 2.0])

    def worse_and_worse(*_: object) -> dict[str, float]:
        error = next(found)
        return {"criterion_px": error, "rmse_px": error, "rmse_px_mean_over_pairs": error,
                "median_px": error, "pck_8px": 0.0}  # fmt: skip

    monkeypatch.setattr("pliant.models.don.trainer.validate", worse_and_worse)
    run = tmp_path / "run"
    train_don(sheet_dataset, run, don(f"validation.keep={keep}"))
    last = last_checkpoint(run).average
    answering = read_weights_file(run / "best.safetensors")
    same = [torch.equal(answering[name], last[name]) for name in last]
    assert all(same) if keep == "last" else not all(same)


def test_a_split_of_one_frame_is_named(sheet_dataset: Dataset) -> None:
    store = FrameStore(sheet_dataset, "sheet", "val", (40, 30))
    store.frames = store.frames[:1]
    message = r"tier sheet, split val: validation draws pairs.*found 1 frame;.*validation.split"
    with pytest.raises(CallError, match=message):
        draw_validation_pairs(store, pairs=2, queries=8, seed=0)


def test_a_run_is_a_folder_that_answers(sheet_dataset: Dataset, tmp_path: Path) -> None:
    run = tmp_path / "run"
    facts = train_don(sheet_dataset, run, don())
    page = (run / "report.html").read_text()
    assert "in training, not calibrated, in pictures of 40x30" in page  # not what the table has
    assert list((run / "tensorboard").iterdir())
    assert [p.name for p in (run / "checkpoints").iterdir()] == ["0000006"]
    assert json.loads((run / "run.json").read_text())["steps"] == 6
    assert not list(run.rglob("*.pt"))
    assert not list(run.rglob("*.pkl"))
    matcher = load_matcher(run)
    assert matcher.familiarity is not None
    described = matcher.describe()
    assert described["tier"] == "sheet"
    assert described["answer"] == settings_to_dict(AnswerSettings(decode="median"))
    json.dumps(described)
    assert facts["validation"]["rmse_px"] > 0
    # The config that was stored is the one that ran, its tier named.
    stored = settings_to_dict(read_settings(DonSettings, run / "config.yaml"))
    assert stored == settings_to_dict(don("tier=sheet"))
    # A finished run is not overwritten either where its checkpoints were removed.
    shutil.rmtree(run / "checkpoints")
    with pytest.raises(CallError, match="must be empty"):
        train_don(sheet_dataset, run, don())


@pytest.mark.parametrize(
    "overrides",
    [
        ["loss.kind=contrastive", "pairs.input=depth"],
        pytest.param(["network.name=resnet18"], marks=pytest.mark.long),
        ["precision=bfloat16", "pairs.views=3", "loss.direction=reverse", "optimiser.average=0"],
        ["pairs.masks=true", "cache=false", "loss.space_weight=0.1"],
    ],
)
def test_other_settings_train_too(
    sheet_dataset: Dataset, tmp_path: Path, overrides: list[str]
) -> None:
    settings = don("steps=2", "validation.every=2", *overrides)
    facts = train_don(sheet_dataset, tmp_path / "run", settings)
    assert facts["steps"] == 2
    load_matcher(tmp_path / "run")


def test_divergence_is_an_error(sheet_dataset: Dataset, tmp_path: Path) -> None:
    settings = don("optimiser.learning_rate=1e30", "optimiser.warmup=0", "optimiser.clip_norm=0")
    with pytest.raises(TrainingError, match=r"/run, step \d+: the gradient is not finite"):
        train_don(sheet_dataset, tmp_path / "run", settings)


def test_what_cannot_go_on_or_answer_is_refused(sheet_dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(CallError, match="not a training run"):
        load_matcher(tmp_path / "nothing")
    run = tmp_path / "run"
    train_don(sheet_dataset, run, don("steps=2"))
    with pytest.raises(TrainingError, match="settings that it was started with"):
        train_don(sheet_dataset, run, don("steps=9"), resume=True)
    folder = known(latest_checkpoint(run))
    (folder / "weights.safetensors").write_bytes(b"broken")
    with pytest.raises(TrainingError, match=r"weights\.safetensors: the weights cannot be read"):
        train_don(sheet_dataset, run, don("steps=2"), resume=True)
    (run / "best.safetensors").write_bytes(b"\x00" * 50)
    with pytest.raises(TrainingError, match=r"best\.safetensors"):
        load_matcher(run)


def test_schedules() -> None:
    cosine = OptimiserSettings(learning_rate=1.0, warmup=10, schedule="cosine")
    rates = [learning_rate(cosine, step, 110) for step in (0, 9, 10, 60, 110)]
    assert rates == pytest.approx([0.1, 1.0, 1.0, 0.5, 0.0])
    # DON's own: 0.9 every 250 steps
    step = OptimiserSettings(learning_rate=1e-4, warmup=0, schedule="step")
    assert learning_rate(step, 249, 3500) == pytest.approx(1e-4)
    assert learning_rate(step, 3499, 3500) == pytest.approx(1e-4 * 0.9**13)


@pytest.mark.long  # gloo aborts now and then while a process exits, on a loaded machine
def test_two_processes_equal_one_with_twice_the_batch(
    sheet_dataset: Dataset, tmp_path: Path
) -> None:
    """Under torchrun with gloo: the same samples, so the same weights up to rounding.

    Every background pixel competes: drawing some would differ from process to process.
    """
    common = ["steps=3", "cache=false", "loss.background=-1", "validation.every=3"]
    alone = tmp_path / "alone"
    train_don(sheet_dataset, alone, don(*common, "batch=2"))
    together = tmp_path / "together"
    defaults = tmp_path / "defaults.yaml"  # not the shipped recipe
    defaults.write_text("")
    own_port = "--standalone --local-addr=127.0.0.1 --nproc-per-node=2 --no-python"
    launch = [sys.executable, "-m", "torch.distributed.run", *own_port.split()]
    data = ["--data", str(sheet_dataset.root), "--config", str(defaults), "--out", str(together)]
    train = [str(Path(sys.executable).parent / "pliant"), "train", "don", *data, "--json"]
    done = subprocess.run(
        [*launch, *train, *options(*DON, *common)],
        capture_output=True,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert json.loads(done.stdout)["processes"] == 2
    one = read_weights_file(latest_checkpoint(alone) / "weights.safetensors")  # type: ignore[operator]
    two = read_weights_file(latest_checkpoint(together) / "weights.safetensors")  # type: ignore[operator]
    moved = 0.0
    for name in one:
        torch.testing.assert_close(one[name], two[name], atol=3e-4, rtol=1e-3, msg=name)
        moved = max(moved, float((one[name] - two[name]).abs().max()))
    assert moved > 0  # they did not by mistake run alone
