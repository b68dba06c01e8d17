"""The local engine: spawned worker processes on this machine, replaced when they die or grow."""

from __future__ import annotations

import contextlib
import faulthandler
import functools
import itertools
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Final

from pliant.generator.runner.engine import Event, Failed, Finished, OpenMaker, Rendered, attempt
from pliant.generator.seeding import SequenceTask

RECYCLE_SEQUENCES: Final = 500
"""A worker is replaced after so many sequences …"""

RECYCLE_GROWTH_BYTES: Final = 400 * 2**20
"""… or when it has grown by so much since its first sequence."""

STALL_S: Final = 3600.0
"""A worker that finishes no frame for so long hangs, and is killed."""

_TICK_S: Final = 0.5
_STOP_S: Final = 5.0

_THREAD_VARIABLES: Final = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


@dataclass
class _Worker:
    number: int
    process: BaseProcess
    pipe: Connection
    task: SequenceTask | None = None
    sequences: int = 0
    first_bytes: int = 0
    heard: float = 0.0
    stalled: bool = False


@dataclass(frozen=True)
class LocalEngine:
    """Runs tasks in processes of this machine.

    Workers are spawned, never forked: Blender does not survive a fork. Each holds one renderer
    and makes one sequence at a time. A worker that dies (a segmentation fault, the kernel's
    out-of-memory killer) or hangs fails its task alone.

    Attributes:
        workers: Processes, >= 1.
        log: File that takes what the workers, Blender included, print.
        gpus: Identifiers of GPUs to share out, one per worker in turn; none leaves the choice to
            the renderer.
        stall_s: A worker that finishes no frame for so many seconds is killed.
    """

    workers: int
    log: Path = field(default=Path(os.devnull))
    gpus: Sequence[str] = ()
    stall_s: float = STALL_S

    def events(
        self, tasks: Sequence[SequenceTask], open_maker: OpenMaker
    ) -> Generator[Event, None, None]:
        """Make the tasks and yield what happens; closing the iterator kills the workers.

        Args:
            tasks: The sequences, started in this order.
            open_maker: Picklable; called once in each worker.
        """
        queue = deque(tasks)
        workers: dict[Connection, _Worker] = {}
        try:
            while queue or any(worker.task for worker in workers.values()):
                busy = sum(worker.task is not None for worker in workers.values())
                for _ in range(min(self.workers, busy + len(queue)) - len(workers)):
                    worker = self._start(_free_number(workers.values()), open_maker)
                    workers[worker.pipe] = worker
                for worker in workers.values():
                    if worker.task is None and queue:
                        _send(worker, queue.popleft())
                for worker in self._ready(workers):
                    event = _receive(worker)
                    yield event
                    if isinstance(event, Rendered):
                        continue
                    worker.task = None
                    if _is_spent(worker, event):
                        del workers[worker.pipe]
                        _stop(worker)
        finally:
            for worker in workers.values():
                if worker.task is not None:
                    worker.process.kill()
            for worker in workers.values():
                _stop(worker)

    def _ready(self, workers: Mapping[Connection, _Worker]) -> list[_Worker]:
        """Wait for busy workers that report something, die, or hang: these are killed.

        An idle worker gets no more tasks: the run does not need it any longer.
        """
        busy = {pipe: worker for pipe, worker in workers.items() if worker.task is not None}
        while True:
            reports = [busy[pipe] for pipe in wait(list(busy), _TICK_S)]  # type: ignore[index]
            now = time.monotonic()
            for worker in reports:
                worker.heard = now
            for worker in busy.values():
                if now - worker.heard > self.stall_s:
                    worker.stalled = True
                    worker.process.kill()  # its pipe ends, which the next round reports
            if reports:
                return reports

    def _start(self, number: int, open_maker: OpenMaker) -> _Worker:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(
            target=_work,
            args=(theirs, open_maker, self.log, worker_cores(number, self.workers)),
            name=f"pliant-worker-{number}",
            daemon=True,
        )
        with _environment(self._variables(number)):
            process.start()
        theirs.close()
        return _Worker(number, process, ours)

    def _variables(self, number: int) -> dict[str, str]:
        """Return the environment a worker starts with: libraries on one thread, one GPU."""
        variables = dict.fromkeys(_THREAD_VARIABLES, "1")
        if self.gpus:
            variables["CUDA_VISIBLE_DEVICES"] = self.gpus[number % len(self.gpus)]
        return variables


def worker_cores(number: int, workers: int) -> list[int]:
    """Return the cores of one of several workers: an even share of those this process may use.

    Blender's task pool starts a thread for every core it may use, and idle ones spin: unbound,
    two workers take a quarter more CPU time than one. With more workers than cores, and where
    the system knows no affinity, all workers use all cores.

    Args:
        number: Worker's number, from 0.
        workers: How many there are.
    """
    if not hasattr(os, "sched_getaffinity"):
        return []
    cores = sorted(os.sched_getaffinity(0))
    if workers > len(cores):
        return cores
    return cores[number * len(cores) // workers : (number + 1) * len(cores) // workers]


def _free_number(workers: Iterable[_Worker]) -> int:
    """Return the least number no worker bears: a replacement takes over its share."""
    taken = {worker.number for worker in workers}
    return next(number for number in itertools.count() if number not in taken)


def visible_gpus() -> list[str]:
    """Return the NVIDIA GPUs that this process may use, without loading a driver."""
    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    if named is not None:
        return [name for name in named.split(",") if name.strip() not in ("", "-1")]
    numbers = (name[6:] for name in os.listdir("/dev") if name.startswith("nvidia"))
    return sorted(number for number in numbers if number.isdigit())


def _send(worker: _Worker, task: SequenceTask) -> None:
    worker.task, worker.heard = task, time.monotonic()
    with contextlib.suppress(OSError):  # a dead worker is noticed when it is read from
        worker.pipe.send(task)


def _receive(worker: _Worker) -> Event:
    assert worker.task is not None  # only busy workers speak
    try:
        event: Event = worker.pipe.recv()
    except (EOFError, OSError):
        worker.process.join(_STOP_S)
        if worker.stalled:
            return Failed(worker.task, "the worker process hung: it was killed")
        return Failed(worker.task, _cause_of_death(worker.process.exitcode))
    return event


def _cause_of_death(exitcode: int | None) -> str:
    if exitcode is not None and exitcode < 0:
        name = signal.Signals(-exitcode).name
        hint = "; the machine may be out of memory" if name == "SIGKILL" else ""
        return f"the worker process was ended by {name}{hint}"
    return f"the worker process ended with exit code {exitcode}"


def _is_spent(worker: _Worker, event: Event) -> bool:
    """Return whether a worker must be replaced: dead, grown, or old."""
    if not isinstance(event, Finished):
        return True  # whatever went wrong may have left something behind
    worker.sequences += 1
    worker.first_bytes = worker.first_bytes or event.result.memory_bytes
    grown = event.result.memory_bytes - worker.first_bytes
    return worker.sequences >= RECYCLE_SEQUENCES or grown >= RECYCLE_GROWTH_BYTES


def _stop(worker: _Worker) -> None:
    with contextlib.suppress(OSError):
        worker.pipe.send(None)
    worker.process.join(_STOP_S)
    if worker.process.is_alive():
        worker.process.kill()
        worker.process.join()
    worker.pipe.close()


@contextlib.contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables for a child that is started meanwhile."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _work(pipe: Connection, open_maker: OpenMaker, log: Path, cores: Sequence[int]) -> None:
    """Serve one worker process: open a maker, make what the pipe asks for, end when it says so."""
    if cores:
        os.sched_setaffinity(0, cores)  # before Blender counts them
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with log.open("a") as stream:  # Blender prints from C: the descriptors themselves must move
        sys.stdout.flush()
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    faulthandler.enable()
    sys.path[:] = [path for path in sys.path if not _is_blenders(path)]
    opened = functools.cache(open_maker)
    while (task := pipe.recv()) is not None:
        frames, reported = 0, time.monotonic()

        def on_frame(task: SequenceTask = task) -> None:
            nonlocal frames, reported
            frames += 1
            if time.monotonic() - reported >= _TICK_S:
                pipe.send(Rendered(task, frames))
                frames, reported = 0, time.monotonic()

        event = attempt(opened, task, on_frame)
        if frames and isinstance(event, Finished):
            pipe.send(Rendered(task, frames))
        pipe.send(event)


def _is_blenders(path: str) -> bool:
    """Return whether an entry of `sys.path` was added by an imported bpy.

    A parent that has imported bpy hands its path on, and there the child would find a `bpy`
    without its compiled half before the real one.
    """
    parts = Path(path).parts
    return "bpy" in parts and "scripts" in parts


def _end_with_parent() -> None:
    """End this process when its parent has ended, however that ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
