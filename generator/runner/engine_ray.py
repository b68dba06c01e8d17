"""The Ray engine: the same tasks on a cluster, whose nodes may come and go."""

from __future__ import annotations

import functools
import os
from collections import deque
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from pliant.generator.runner.engine import (
    Event,
    Failed,
    Finished,
    OpenMaker,
    Rendered,
    attempt,
    failure,
)
from pliant.generator.seeding import SequenceTask
from pliant.spec.errors import MissingExtraError

RECYCLE_SEQUENCES: Final = 500
"""A Ray worker is replaced after so many sequences."""

SYSTEM_RETRIES: Final = 5
"""How often Ray repeats a sequence whose worker or node was lost."""

_AHEAD: Final = 2
# Tasks submitted per worker: one runs, one waits, so that no worker idles; the rest stays with
# the driver, whose death then leaves little behind on the cluster.


@dataclass(frozen=True)
class RayEngine:
    """Runs tasks on the Ray cluster this process is connected to, or a local one.

    The dataset's folder must be on a file system that every node shares. `ray.init` is called
    if nobody has: it joins the cluster of `RAY_ADDRESS`, or starts a local one.

    Attributes:
        workers: Sequences in work at a time.
        gpus_per_worker: GPUs Ray reserves, and makes visible, for each sequence in work; None
            is one where the cluster has any, else none.
    """

    workers: int
    gpus_per_worker: float | None = None

    def events(
        self, tasks: Sequence[SequenceTask], open_maker: OpenMaker
    ) -> Generator[Event, None, None]:
        """Make the tasks and yield what happens; closing the iterator cancels the rest.

        Args:
            tasks: The sequences, started in this order.
            open_maker: Picklable; called once in each Ray worker.

        Raises:
            MissingExtraError: Ray is not installed.
        """
        try:
            import ray
        except ImportError as error:
            raise MissingExtraError("--engine ray", "cluster") from error

        started_here = not ray.is_initialized()
        if started_here:
            cores = None if os.environ.get("RAY_ADDRESS") else self.workers
            ray.init(num_cpus=cores, log_to_driver=False, include_dashboard=False)
        gpus = self.gpus_per_worker
        if gpus is None:
            gpus = 1.0 if ray.cluster_resources().get("GPU") else 0.0
        make = ray.remote(
            max_retries=SYSTEM_RETRIES, max_calls=RECYCLE_SEQUENCES, num_cpus=1, num_gpus=gpus
        )(_make)
        queue = deque(tasks)
        running: dict[Any, SequenceTask] = {}
        try:
            shared = ray.put(open_maker)
            while queue or running:
                while queue and len(running) < _AHEAD * self.workers:
                    task = queue.popleft()
                    running[make.remote(shared, task)] = task
                (done,), _ = ray.wait(list(running), num_returns=1)
                task = running.pop(done)
                try:
                    event: Finished | Failed = ray.get(done)
                except ray.exceptions.RayError as error:
                    event = failure(task, error)
                if isinstance(event, Finished):
                    yield Rendered(task, event.result.frames)
                yield event
        finally:
            for reference in running:
                ray.cancel(reference, force=True)
            if started_here:
                ray.shutdown()


_OPENED: dict[str, OpenMaker] = {}
# One maker per Ray worker process, kept between its tasks: Blender starts once.


def _make(open_maker: OpenMaker, task: SequenceTask) -> Finished | Failed:
    key = repr(open_maker)
    if key not in _OPENED:
        _OPENED[key] = functools.cache(open_maker)
    return attempt(_OPENED[key], task, lambda: None)
