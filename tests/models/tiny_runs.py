"""Settings of trainings that take a second or two: on the sheets, and on the tests' episode."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import pytest

from pliant.models.don.settings import DonSettings
from pliant.models.timecycle.settings import TimeCycleSettings
from pliant.spec.configuration import read_settings

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
