"""A whole training run: processes, the run's folder, the loop, and the final measurements."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TypedDict

import torch

from pliant.models.training.checkpoint import BEST, load_best
from pliant.models.training.loop import StepProgress, train
from pliant.models.training.processes import Processes, agree, joined_processes
from pliant.models.training.run_folder import open_run, run_facts, with_tier
from pliant.models.training.task import Chosen, Task
from pliant.spec.dataset import Dataset
from pliant.spec.errors import TrainingError


class RunOptions(TypedDict, total=False):
    """How a run is started.

    Attributes:
        resume: Go on from the newest checkpoint.
        progress: Called after each step.
    """

    resume: bool
    progress: StepProgress | None


def train_task(
    task_type: type[Task[Chosen]],
    dataset: Dataset,
    run: Path,
    settings: Chosen,
    options: RunOptions,
) -> dict[str, Any]:
    """Train a method; afterwards `load_matcher(run)` answers.

    Under `torchrun` every process calls this with the same arguments; process 0 writes.

    Args:
        task_type: The method.
        dataset: The dataset.
        run: The run's folder: new or empty, or with `resume` one that was begun.
        settings: The config.
        options: How the run is started.

    Returns:
        The run's facts, as in `run.json`, with the final figures.

    Raises:
        CallError: The config does not fit the dataset, or the folder is in use.
        TrainingError: Nothing to resume, another config than it began with, or divergence.
    """
    settings = settings.replace(tier=with_tier(settings.tier, dataset))
    if settings.threads:
        torch.set_num_threads(settings.threads)
    resume = options.get("resume", False)
    with (
        joined_processes() as processes,
        _opened(run, settings, resume, task_type.answering, processes),
    ):
        task = task_type(dataset, settings, run, processes)
        state = train(task, run, **options)
        facts = run_facts(dataset, settings, state.step, processes) | task.facts()
        if processes.first and (run / BEST).is_file():
            load_best(task.network, run)
            task.finish(run, state.history, facts)
    return facts


@contextmanager
def _opened(
    run: Path, settings: Chosen, resume: bool, answering: str, processes: Processes
) -> Iterator[None]:
    """Open the run's folder in process 0; the others write to it (its cache) only then."""
    with ExitStack() as stack:
        if processes.first:
            try:
                stack.enter_context(open_run(run, settings, resume, answering))
            except BaseException:
                agree(False, processes)
                raise
        if not agree(True, processes):
            raise TrainingError("process 0 could not open the run", path=run)
        yield
