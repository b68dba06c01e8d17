"""What a run will take, by trial: one short sequence of each tier, made and thrown away."""

from __future__ import annotations

import functools
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.engine import Failed, Finished
from pliant.generator.runner.engine_local import LocalEngine
from pliant.generator.runner.plan import Plan, first_of_each_tier
from pliant.generator.runner.run import open_sequence_maker, required_packages
from pliant.spec.errors import CallError, GenerationError
from pliant.spec.extras import require_packages

TRIAL_FRAMES: Final = 3


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


def estimate_run(config: GenerateConfig, plan: Plan, workers: int) -> Estimate:
    """Measure a sequence of at most three frames per tier and extrapolate.

    Args:
        config: The dataset's config.
        plan: What is missing.
        workers: Sequences in work at a time.

    Raises:
        CallError: There is no worker.
        GenerationError: A trial sequence cannot be made.
    """
    if workers < 1:
        raise CallError("there must be a worker", where="workers", found=workers, required=">= 1")
    require_packages(required_packages(config.style), "generating a dataset", "generate")
    missing = plan.missing
    short = replace(config, frames=min(config.frames, TRIAL_FRAMES))
    seconds = size = 0.0
    with tempfile.TemporaryDirectory(prefix="pliant-trial-") as folder:
        root = Path(folder)
        open_maker = functools.partial(open_sequence_maker, short, root, root / "partial", 1)
        for event in LocalEngine(1).events(first_of_each_tier(missing), open_maker):
            if isinstance(event, Failed):
                raise GenerationError(
                    "the trial sequence failed", where=event.task.id, found=event.error
                )
            if isinstance(event, Finished):
                alike = sum(task.tier == event.task.tier for task in missing)
                frames = alike * config.frames / event.result.frames
                seconds += event.result.seconds * frames / workers
                size += event.result.bytes * frames
    return Estimate(seconds, round(size), len(missing) * (2 * config.frames + 4))
