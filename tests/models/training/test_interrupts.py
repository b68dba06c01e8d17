"""Ctrl-C at any moment of a training: resumed, it ends as if it had not been interrupted."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch.utils.data import Dataset as TorchDataset

from pliant.models.don.trainer import train_don
from pliant.models.training.processes import Processes
from pliant.models.training.task import Task
from pliant.spec.dataset import Dataset
from tests.models.tiny_runs import assert_same_runs, don

SETTINGS = don("checkpoint_every=100", "optimiser.kind=muon")  # TimeCycle's test has AdamW


def interrupt_at(call: int, function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that sends SIGINT at its call of this number, counted from 1."""
    calls = 0

    def interrupted(*arguments: Any, **named: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == call:
            os.kill(os.getpid(), signal.SIGINT)
        return function(*arguments, **named)

    return interrupted


@pytest.fixture(scope="module")
def whole(sheet_dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("interrupts") / "whole"
    train_don(sheet_dataset, run, SETTINGS)
    return run


@pytest.mark.parametrize(
    ("place", "call"),
    [
        ("pliant.models.training.loop.average_gradients", 2),
        ("pliant.models.training.loop._update_average", 2),
        ("pliant.models.don.trainer.validate", 1),
        ("pliant.models.don.trainer.validate", 2),
        ("pliant.models.training.loop.save_weights", 1),
        ("pliant.models.training.checkpoint.save_weights", 2),
        ("pliant.models.don.trainer.calibrate", 1),
        ("pliant.models.don.matcher.DonMatcher.fitted_familiarity", 1),
    ],
)
def test_resumed_equals_uninterrupted(
    sheet_dataset: Dataset,
    whole: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    place: str,
    call: int,
) -> None:
    function = resolve_name(place)
    run = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(place, interrupt_at(call, function))
        with pytest.raises(KeyboardInterrupt):
            train_don(sheet_dataset, run, SETTINGS)
    assert not (run / "run.json").exists()  # what a finished run has
    train_don(sheet_dataset, run, SETTINGS, resume=True)
    assert_same_runs(whole, run, steps=6)
    for file in ("calibration.json", "familiarity.json"):
        assert (whole / file).read_text() == (run / file).read_text()


class Deaf(TorchDataset[torch.Tensor]):
    """Samples that say whether their process ignores Ctrl-C."""

    def __getitem__(self, index: int) -> torch.Tensor:
        return torch.tensor(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))


@pytest.mark.parametrize("workers", [0, 1])
def test_loader_processes_leave_interrupts_to_the_training(workers: int) -> None:
    processes = Processes(0, 1, torch.device("cpu"))
    settings = SETTINGS.replace(workers=workers, batch=1)
    task: Any = SimpleNamespace(processes=processes, settings=settings, samples=Deaf())
    ignored: Any = next(Task.batches(task, 0, 1))
    assert ignored.item() == bool(workers)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
