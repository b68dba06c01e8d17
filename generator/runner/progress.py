"""Progress of a run, its remaining time estimated from finished sequences, and its outcome."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from pliant.generator.runner.engine import SequenceResult
from pliant.generator.runner.manifest import Failure
from pliant.generator.runner.plan import Plan
from pliant.generator.seeding import SequenceTask


class Left(NamedTuple):
    """What is left of a run.

    Attributes:
        seconds: Wall time, with as many workers as ran while the sequences were measured.
        bytes: Space of the sequences that are missing.
    """

    seconds: float
    bytes: float


@dataclass
class _Cost:
    """Sums over the measured sequences of a tier; `timed_frames` took the `seconds`."""

    frames: int = 0
    bytes: int = 0
    timed_frames: int = 0
    seconds: float = 0.0


@dataclass
class Forecast:
    """Cost of an image, tier by tier; nothing is forecast for a tier before it is measured.

    A worker's first sequence of a tier also loads or compiles code: its size counts, its time does
    not. Sequences are timed while the other workers work, so the figures contain what they take
    from each other.

    Attributes:
        workers: Sequences in work at a time.
        frames_left: Tier -> frames of its sequences that are not finished.
    """

    workers: int
    frames_left: dict[str, int]
    _costs: dict[str, _Cost] = field(default_factory=dict)

    @classmethod
    def of(cls, missing: Iterable[SequenceTask], frames: int, workers: int) -> Forecast:
        """Return the forecast of a run that has made nothing yet.

        Args:
            missing: Its sequences.
            frames: Frames of each.
            workers: Sequences in work at a time.
        """
        tiers = Counter(task.tier for task in missing)
        return cls(workers, {tier: count * frames for tier, count in tiers.items()})

    def finish(self, tier: str, result: SequenceResult) -> None:
        """Count a finished sequence: record its cost and remove it from the remaining ones."""
        self.measure(tier, result)
        self.frames_left[tier] -= result.frames

    def measure(self, tier: str, result: SequenceResult) -> None:
        """Add the size of a sequence, and its time unless it is its worker's first of the tier."""
        cost = self._costs.setdefault(tier, _Cost())
        cost.frames += result.frames
        cost.bytes += result.bytes
        if result.warm:
            cost.timed_frames += result.frames
            cost.seconds += result.seconds

    def left(self) -> Left | None:
        """Return remaining time and size; None until each unfinished tier has been timed."""
        per_image = self.per_image()
        waiting = {tier: frames for tier, frames in self.frames_left.items() if frames > 0}
        if waiting.keys() - per_image.keys():
            return None
        seconds = sum(per_image[tier][0] * frames for tier, frames in waiting.items())
        size = sum(per_image[tier][1] * frames for tier, frames in waiting.items())
        return Left(seconds / self.workers, size)

    def per_image(self) -> dict[str, tuple[float, float]]:
        """Return tier -> (seconds of a worker, bytes) per image, for the timed tiers."""
        return {
            tier: (cost.seconds / cost.timed_frames, cost.bytes / cost.frames)
            for tier, cost in self._costs.items()
            if cost.timed_frames
        }


@dataclass
class RunState:
    """How far a run is; the same object is shown again and again while it runs.

    Attributes:
        plan: What the run set out to do.
        sequences: Sequences in place, those of earlier runs included.
        frames: Frames rendered in this run, without those of failed attempts.
        frames_wanted: Frames this run has to render.
        bytes: Bytes this run wrote.
        failures: Failed attempts so far.
        memory_bytes: Largest resident memory a worker reported.
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
    log: Path | None = None


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
        """True if all sequences were there before the run; it may have written tables again."""
        return self.made == 0 and not self.failed
