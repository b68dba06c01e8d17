"""How far a run is, and how it ended."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

from pliant.generator.runner.forecast import Forecast
from pliant.generator.runner.manifest import Failure
from pliant.generator.runner.plan import Plan


@dataclass
class Progress:
    """How far a run is; the same object is shown again and again while it runs.

    Attributes:
        plan: What the run set out to do.
        sequences: Sequences in place, those of earlier runs included.
        frames: Frames rendered in this run.
        frames_wanted: Frames this run has to render.
        bytes: Bytes this run wrote.
        failures: Failed attempts so far.
        memory_bytes: Largest resident memory a worker reported.
        started: `time.monotonic()` at the start of the rendering.
        log: The run's log file.
        forecast: What is left, from what the finished sequences took.
    """

    plan: Plan
    sequences: int
    frames_wanted: int
    forecast: Forecast
    frames: int = 0
    bytes: int = 0
    failures: int = 0
    memory_bytes: int = 0
    started: float = field(default_factory=time.monotonic)
    log: Path | None = None

    @classmethod
    def of(cls, plan: Plan, workers: int, log: Path) -> Progress:
        """Return the progress of a run that begins."""
        missing, frames = plan.missing, plan.frames_per_sequence
        forecast = Forecast.of(missing, frames, workers)
        return cls(plan, len(plan.finished), len(missing) * frames, forecast, log=log)

    @property
    def seconds(self) -> float:
        """Seconds since the rendering began."""
        return time.monotonic() - self.started

    @property
    def images_per_s(self) -> float:
        """Images a second, all workers together."""
        return self.frames / self.seconds if self.frames else 0.0


@dataclass(frozen=True)
class Summary:
    """How a run ended.

    Attributes:
        root: The dataset's folder.
        sequences: Sequences of the dataset that are in place.
        made: Sequences this run made.
        frames: Frames this run rendered.
        bytes: Bytes this run wrote into sequences.
        seconds: Wall time of the run.
        failed: Sequences that could not be made, each with its traceback.
    """

    root: Path
    sequences: int
    made: int
    frames: int
    bytes: int
    seconds: float
    failed: tuple[Failure, ...] = ()

    @property
    def unchanged(self) -> bool:
        """True if the set was finished before the run."""
        return self.made == 0 and not self.failed
