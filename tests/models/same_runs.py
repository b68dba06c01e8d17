"""Whether two training runs ended alike, bit for bit."""

from __future__ import annotations

from pathlib import Path

import torch

from pliant.models.training.checkpoint import TrainingState, latest_checkpoint, read_checkpoint
from tests.known import known


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
