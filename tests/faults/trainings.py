"""Trainings of three steps, for the faults' commands."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from tests.faults.inputs import pliant

Run = Callable[[Path, Path], int]

DON: Final = (
    "steps=3", "batch=1", "width=40", "height=30", "seed=3", "network.widths=[8, 32]",
    "network.descriptor_dim=4", "pairs.queries=8", "optimiser.warmup=1", "checkpoint_every=1",
    "validation={split: train, every: 2, pairs: 1, queries: 8, calibration_pairs: 1}",
)  # fmt: skip
TIMECYCLE: Final = (
    "steps=3", "batch=1", "width=48", "height=32", "seed=3", "optimiser.warmup=1",
    "network={descriptor_dim: 8, widths: [8, 32], global_blocks: 1}", "checkpoint_every=1",
    "clips={length: 3, step_max: 2, patches: 1}",
    "validation={split: train, every: 2, clips: 1, frames: 3, queries: 8}",
)  # fmt: skip


def training(method: str, data: str, settings: Iterable[str]) -> tuple[Run, Run]:
    """Return a training, and what continues it after an interruption.

    Args:
        method: Subcommand of `pliant train`.
        data: Name of the dataset's folder in the inputs.
        settings: Values of `--set`.
    """
    chosen = [part for each in settings for part in ("--set", each)]

    def train(inputs: Path, work: Path, *options: str) -> int:
        out = ("--out", work / "run")
        return pliant("train", method, "--data", inputs / data, *out, *chosen, *options)

    def again(inputs: Path, work: Path) -> int:
        from pliant.models.training.checkpoint import latest_checkpoint

        return train(inputs, work, *["--resume"] * bool(latest_checkpoint(work / "run")))

    return train, again
