"""What an engine is: it makes the tasks it is given somewhere, and says how each ended."""

from __future__ import annotations

import errno
import os
import traceback
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

from pliant.generator.seeding import SequenceTask
from pliant.spec.errors import PliantError

STAGES: Final = ("sample", "pose", "truth", "render", "noise", "encode", "tables")
"""What making a sequence consists of, as timed."""


@dataclass(frozen=True)
class SequenceResult:
    """What a worker reports of a finished sequence.

    Attributes:
        id: The sequence.
        frames: Its frames.
        bytes: Size of its files.
        seconds: Wall time.
        cpu_s: CPU seconds of the worker process, all threads.
        stage_cpu_s: Stage -> CPU seconds of the thread that did it, for `STAGES`. A renderer's
            own threads are not seen here: subtract the other stages from `cpu_s`.
        memory_bytes: Resident memory of the worker afterwards.
        setup_cpu_s: Part of `cpu_s` that does not grow with the number of frames.
        warm: Whether this worker had made a sequence of the tier before.
    """

    id: str
    frames: int
    bytes: int
    seconds: float
    cpu_s: float
    stage_cpu_s: dict[str, float] = field(default_factory=dict)
    memory_bytes: int = 0
    setup_cpu_s: float = 0.0
    warm: bool = False


class Maker(Protocol):
    """Makes sequences in a worker process, one after another."""

    def make(self, task: SequenceTask, on_frame: Callable[[], None]) -> SequenceResult:
        """Make one sequence and put it into place; call `on_frame` after each frame."""
        ...


OpenMaker = Callable[[], Maker]
"""Opens a maker in a worker; picklable."""

FATAL_ERRNOS: Final = (errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS)
"""Errors of the output folder: no retry helps, and every other sequence would fail too."""


@dataclass(frozen=True)
class Rendered:
    """Some frames of an unfinished sequence are done.

    Attributes:
        frames: Frames since the last such event of this sequence.
    """

    task: SequenceTask
    frames: int


@dataclass(frozen=True)
class Finished:
    """A sequence is in place."""

    task: SequenceTask
    result: SequenceResult


@dataclass(frozen=True)
class Failed:
    """A sequence was not made.

    Attributes:
        error: Traceback, or how the worker died.
        fatal: Why the whole run must stop (disk full …), None for a failure of this sequence.
        settled: Every attempt would fail in this way: the settings are to blame.
    """

    task: SequenceTask
    error: str
    fatal: str | None = None
    settled: bool = False


Event = Rendered | Finished | Failed


class Engine(Protocol):
    """Runs tasks; results do not depend on which engine, nor on how many workers."""

    @property
    def workers(self) -> int:
        """Sequences in work at a time."""
        ...

    def events(
        self, tasks: Sequence[SequenceTask], open_maker: OpenMaker
    ) -> Generator[Event, None, None]:
        """Make the tasks and yield what happens; one `Finished` or `Failed` per task.

        Closing the iterator stops the workers.
        """
        ...


def attempt(
    opened: OpenMaker, task: SequenceTask, on_frame: Callable[[], None]
) -> Finished | Failed:
    """Make one sequence, turning whatever goes wrong into an event.

    Args:
        opened: Returns the worker's maker, which it opens for the first sequence.
        task: Which sequence.
        on_frame: Called after each frame.
    """
    try:
        return Finished(task, opened().make(task, on_frame))
    except Exception as error:
        return failure(task, error)


def failure(task: SequenceTask, error: Exception) -> Failed:
    """Return the event of an exception, fatal where the output folder is to blame."""
    fatal = None
    settled = isinstance(error, PliantError)
    cause: BaseException | None = error
    while cause is not None and fatal is None:
        settled &= not isinstance(cause, OSError)
        if isinstance(cause, OSError) and cause.errno in FATAL_ERRNOS:
            fatal = os.strerror(cause.errno) + (f" ({cause.filename})" if cause.filename else "")
        cause = cause.__cause__ or cause.__context__
    text = "".join(traceback.format_exception(error)).rstrip()
    return Failed(task, text, fatal, settled)
