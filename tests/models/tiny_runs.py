"""Settings of trainings that take a second or two: on the sheets, and on the tests' episode."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest
import torch

from pliant.models.don.settings import DonSettings
from pliant.models.timecycle.settings import TimeCycleSettings
from pliant.models.training.checkpoint import TrainingState, latest_checkpoint, read_checkpoint
from pliant.spec.configuration import read_settings
from tests.known import known

DON: Final = (
    "steps=6",
    "batch=1",
    "width=40",
    "height=30",
    "seed=3",
    "network={widths: [8, 16, 32], descriptor_dim: 4}",
    "pairs.queries=8",
    "validation={every: 3, pairs: 2, queries: 8, calibration_pairs: 2}",
    "checkpoint_every=2",
    "optimiser.warmup=2",
)
TIMECYCLE: Final = (
    "steps=6",
    "batch=1",
    "width=96",
    "height=64",
    "seed=3",
    "network={descriptor_dim: 16, widths: [8, 16, 32], global_blocks: 1}",
    "clips={length: 3, step_max: 3, patches: 1}",
    "validation={split: test, every: 3, clips: 2, frames: 5, queries: 8}",
    "checkpoint_every=2",
    "optimiser.warmup=2",
)


def don(*overrides: str) -> DonSettings:
    return read_settings(DonSettings, None, [*DON, *overrides])


def timecycle(*overrides: str) -> TimeCycleSettings:
    return read_settings(TimeCycleSettings, None, [*TIMECYCLE, *overrides])


def train_two_steps(train: Callable[..., object], *given: object) -> None:
    """Begin a training that is interrupted after its second step."""

    def interrupt(step: int, figures: object) -> None:
        if step == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(*given, progress=interrupt)


def options(*overrides: str) -> list[str]:
    """Return the overrides as options of a command."""
    return [part for value in overrides for part in ("--set", value)]


def last_checkpoint(run: Path) -> TrainingState:
    latest = known(latest_checkpoint(run))
    return read_checkpoint(latest)


def assert_same_runs(whole: Path, parts: Path, steps: int) -> None:
    """Check weights, running average, optimiser, history and the weights that answer."""
    a, b = last_checkpoint(whole), last_checkpoint(parts)
    assert a.step == b.step == steps
    assert a.history == b.history
    assert a.best == b.best
    assert a.optimiser["state"].keys() == b.optimiser["state"].keys()
    for left, right in (
        (a.weights, b.weights),
        (a.average, b.average),
        *zip(a.optimiser["state"].values(), b.optimiser["state"].values(), strict=True),
    ):
        assert left.keys() == right.keys()
        for name in left:
            assert torch.equal(left[name], right[name]), name
    assert (whole / "best.safetensors").read_bytes() == (parts / "best.safetensors").read_bytes()
