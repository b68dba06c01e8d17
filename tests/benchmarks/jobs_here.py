"""The jobs of a benchmark, and its sets, in the test's own process."""

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
