"""What a run will take, by trial: short sequences of each tier, made and thrown away."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.engine import Failed, Finished, OpenMaker, SequenceResult
from pliant.generator.runner.engine_local import LocalEngine
from pliant.generator.runner.plan import Plan
from pliant.generator.runner.progress import Forecast
from pliant.generator.runner.run import check_call, sequence_maker
from pliant.generator.seeding import SequenceTask
from pliant.spec.errors import GenerationError

TRIAL_FRAMES: Final = 6

TRIAL_ROUNDS: Final = 3
"""Sequences of each tier that a worker makes: the first also loads code."""


@dataclass(frozen=True)
class Estimate:
    """What is left of a run.

    Attributes:
        seconds: Wall time with the workers asked for.
        bytes: Space the missing sequences will take.
        files: How many files they are.
    """

    seconds: float
    bytes: int
    files: int


def estimate_run(
    config: GenerateConfig, plan: Plan, workers: int, open_maker: OpenMaker | None = None
) -> Estimate:
    """Measure sequences of at most six frames of each tier, with all workers busy.

    Args:
        config: The dataset's config.
        plan: What is missing.
        workers: Sequences in work at a time.
        open_maker: What makes the trial sequences, picklable; None renders them.

    Raises:
        CallError: The number of workers is less than 1.
        MissingExtraError: Numba, or for its styles Blender, is not installed.
        GenerationError: A trial sequence cannot be made.
    """
    check_call(config, workers, open_maker)
    missing = plan.missing
    if not missing:
        return Estimate(0.0, 0, 0)
    forecast = Forecast.of(missing, config.frames, workers)
    short = config.replace(frames=min(config.frames, TRIAL_FRAMES))
    trials = [
        SequenceTask(tier, "train", number)
        for tier in forecast.frames_left
        for number in range(TRIAL_ROUNDS * workers)
    ]
    with tempfile.TemporaryDirectory(prefix="pliant-trial-") as folder:
        root = Path(folder)
        maker = open_maker or sequence_maker(short, root)
        started, start_s = time.monotonic(), None
        for event in LocalEngine(workers).events(trials, maker):
            if isinstance(event, Failed):
                raise GenerationError(
                    "the trial sequence failed", where=event.task.id, found=event.error
                )
            if isinstance(event, Finished):
                if start_s is None:  # of the workers, without their first sequence
                    start_s = time.monotonic() - started - event.result.seconds
                forecast.measure(event.task.tier, at_length(event.result, config.frames))
    left = forecast.left()
    assert left is not None  # every tier that is missing was tried
    assert start_s is not None
    files = len(missing) * (2 * config.frames + 4)
    return Estimate(start_s + left.seconds, round(left.bytes), files)


def at_length(result: SequenceResult, frames: int) -> SequenceResult:
    """Return what a sequence would take with another number of frames.

    Args:
        result: What it took.
        frames: The number of frames.
    """
    growth = frames / result.frames
    setup = result.setup_cpu_s / result.cpu_s if result.cpu_s else 0.0
    return replace(
        result,
        frames=frames,
        bytes=round(result.bytes * growth),
        seconds=result.seconds * (setup + (1 - setup) * growth),
    )
