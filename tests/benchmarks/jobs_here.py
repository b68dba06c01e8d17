"""The jobs of a benchmark, and its sets, in the test's own process; a watcher of its progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any

import pytest

from pliant.benchmarks.suite import jobs as suite_jobs
from pliant.benchmarks.suite import run as suite_run
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.progress import Summary
from pliant.generator.runner.run import generate
from tests.generator.runner import standin


class Recorder:
    """A watcher that remembers."""

    def __init__(self) -> None:
        self.begun: list[tuple[str, int, int]] = []
        self.done: list[str] = []
        self.steps: list[tuple[str, int, int]] = []
        self.interrupt_at: str | None = None

    def begin(self, stage: str, jobs: int, finished: int) -> None:
        self.begun.append((stage, jobs, finished))

    def started(self, job: str) -> None:
        if job == self.interrupt_at:
            raise KeyboardInterrupt

    def progress(self, job: str, done: int, total: int) -> None:
        self.steps.append((job, done, total))

    def ended(self, job: str, wall_s: float, cpu_s: float, error: str) -> None:
        assert wall_s > 0
        assert cpu_s > 0
        assert not error
        self.done.append(job)


class InProcess:
    """Runs the jobs in this process: the pool's own processes are tested by the other runs."""

    def __init__(self, *_: object, initializer: Any, initargs: Any, **__: object) -> None:
        initializer(*initargs)

    def __enter__(self) -> InProcess:
        return self

    def __exit__(self, *_: object) -> None:
        suite_jobs._NEWS.clear()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(function(*arguments))
        return done


def generate_here(config: GenerateConfig, *arguments: Any, **options: Any) -> Summary:
    """Make a set here; Blender gets a process of its own."""
    engine: Any = standin.InProcess() if config.style == "raster" else "local"
    return generate(config, *arguments, **options, engine=engine)


@contextmanager
def jobs_here() -> Iterator[None]:
    """Run the jobs here, one after another, and leave the number of threads as it was."""
    torch = pytest.importorskip("torch")
    threads = torch.get_num_threads()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suite_jobs, "ProcessPoolExecutor", InProcess)
        patch.setattr(suite_run, "generate", generate_here)
        yield
    torch.set_num_threads(threads)
