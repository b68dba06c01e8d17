"""A training run, whatever is trained: processes, folder, steps, checkpoints, validation.

A `Task` says what a batch's loss is and how good the network is; the loop does the rest. All
randomness of a step comes from the seed and the step's number, so a resumed run takes the
same steps as one that was never stopped.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TypedDict

import torch
from torch import nn

from pliant.models.training.checkpoint import (
    BEST,
    TrainingState,
    Weights,
    checkpoint_to_resume,
    load_best,
    read_checkpoint,
    remove_others,
    save_checkpoint,
    save_weights,
)
from pliant.models.training.optimiser import learning_rate, make_optimiser
from pliant.models.training.processes import (
    Processes,
    agree,
    average_gradients,
    interrupts_deferred,
    joined_processes,
)
from pliant.models.training.run_folder import (
    TENSORBOARD,
    data_digest,
    open_run,
    run_facts,
    with_tier,
)
from pliant.models.training.settings import Chosen, RunSettings
from pliant.models.training.task import Task
from pliant.spec.configuration import settings_to_dict
from pliant.spec.dataset import Dataset
from pliant.spec.errors import TrainingError

StepProgress = Callable[[int, Mapping[str, float]], None]
"""Called after each step with the steps done and the latest figures."""

_LOG_EVERY = 10
_CRITERION = "val/criterion_px"


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
        state = _train(task, run, resume, options.get("progress"))
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


def _train(
    task: Task[Any], run: Path, resume: bool, progress: StepProgress | None
) -> TrainingState:
    """Train, or go on training, in a folder that exists; return where the run stands."""
    network, settings, processes = task.network, task.settings, task.processes
    optimiser = make_optimiser(network, settings.optimiser)
    state = _start(task, optimiser, run, resume)

    def conclude_step() -> None:
        """Validate and save where it is due."""
        if _validation_is_due(state, settings):
            _validate(task, run, state, writer)
        last = state.step == settings.steps
        if processes.first and (last or state.step % settings.checkpoint_every == 0):
            _save(run, state, network, optimiser)
        if progress is not None:
            progress(state.step, _figures(state))

    with _log_writer(run, processes) as writer:
        try:
            # A run that was interrupted while it validated has not concluded its last step.
            if resume:
                conclude_step()
            for batch in task.batches(state.step, settings.steps):
                with interrupts_deferred():  # half a step cannot be resumed
                    _step(task, run, batch, state, optimiser, writer)
                conclude_step()
        except KeyboardInterrupt:
            if processes.first:
                with interrupts_deferred():
                    _save(run, state, network, optimiser)
            raise
    return state


def _step(
    task: Task[Any],
    run: Path,
    batch: Mapping[str, torch.Tensor],
    state: TrainingState,
    optimiser: torch.optim.Optimizer,
    writer: Any,
) -> None:
    """Take one step, and log its figures every few steps."""
    network, settings, processes = task.network, task.settings, task.processes
    step, device = state.step, processes.device
    network.train()
    rate = learning_rate(settings.optimiser, step, settings.steps)
    for group in optimiser.param_groups:
        group["lr"] = rate * group["ratio"]
    generator = torch.Generator(device=device)
    generator.manual_seed((settings.seed * 1_000_003 + step) * 1_009 + processes.rank)
    batch = {name: tensor.to(device, non_blocking=True) for name, tensor in batch.items()}
    loss, parts = task.loss(batch, step / settings.steps, generator)
    optimiser.zero_grad(set_to_none=True)
    loss.backward()
    parameters = [p for p in network.parameters() if p.requires_grad]
    average_gradients(parameters, processes)
    norm = nn.utils.clip_grad_norm_(parameters, settings.optimiser.clip_norm or math.inf)
    if not bool(torch.isfinite(norm)):
        raise TrainingError(
            "the gradient is not finite",
            path=run,
            where=f"step {step}",
            found=f"loss {float(loss.detach())}",
            fix="Lower optimiser.learning_rate or use precision: float32",
        )
    optimiser.step()
    state.step = step + 1
    _update_average(state.average, network, settings.optimiser.average, state.step)
    if state.step % _LOG_EVERY == 0 or state.step == settings.steps:
        figures = {
            "loss": float(loss.detach()),
            "learning_rate": optimiser.param_groups[0]["lr"],
            "gradient_norm": float(norm),
            **{name: float(value) for name, value in parts.items()},
        }
        _log(writer, state, figures)


def _log(writer: Any, state: TrainingState, figures: Mapping[str, float]) -> None:
    """Add figures of the newest step to the history and to TensorBoard's log."""
    if not _figures(state):
        state.history.append({"step": state.step})
    state.history[-1].update(figures)
    for name, value in figures.items() if writer else ():
        writer.add_scalar(name, value, state.step)


def _figures(state: TrainingState) -> Mapping[str, float]:
    """Return what is logged of the newest step; empty where nothing is."""
    newest = state.history[-1] if state.history else {}
    return newest if newest.get("step") == state.step else {}


def _start(
    task: Task[Any], optimiser: torch.optim.Optimizer, run: Path, resume: bool
) -> TrainingState:
    network, data = task.network, data_digest(task.datasets)
    settings = settings_to_dict(task.settings)
    if not resume:
        world = task.processes.world
        return TrainingState(0, {}, _copy(network), {}, data, settings=settings, processes=world)
    checkpoint = checkpoint_to_resume(run)
    state = read_checkpoint(checkpoint)
    if state.data != data:
        raise TrainingError(
            "a run resumes only with the datasets that it was started with",
            path=run,
            found=", ".join(each.address for each in task.datasets),
            required="the same datasets with the same sequences",
            fix="Name them, or start another run.",
        )
    if state.processes != task.processes.world:
        raise TrainingError(
            "a run goes on with as many processes as it began with, because a step takes samples "
            "for each",
            path=run,
            found=task.processes.world,
            required=state.processes,
            fix=f"Start them with torchrun --nproc-per-node {state.processes}, or start another "
            "run.",
        )
    state.settings = settings  # those that change no step may differ now
    remove_others(checkpoint)
    network.load_state_dict(state.weights)
    optimiser.load_state_dict(state.optimiser)
    device = next(network.parameters()).device
    state.average = {name: tensor.to(device) for name, tensor in state.average.items()}
    return state


def _save(
    run: Path, state: TrainingState, network: nn.Module, optimiser: torch.optim.Optimizer
) -> None:
    state.weights = _copy(network)
    state.optimiser = optimiser.state_dict()
    save_checkpoint(run, state)


def _copy(network: nn.Module) -> Weights:
    return {name: tensor.detach().clone() for name, tensor in network.state_dict().items()}


@torch.no_grad()
def _update_average(average: Weights, network: nn.Module, keep: float, step: int) -> None:
    """Move the average towards the weights; early on it forgets faster, so it starts unbiased."""
    keep = min(keep, (1 + step) / (10 + step)) if keep else 0.0
    now = network.state_dict()
    moving = [name for name, tensor in now.items() if tensor.is_floating_point()]
    torch._foreach_lerp_(
        [average[name] for name in moving], [now[name] for name in moving], 1 - keep
    )
    for name in now.keys() - set(moving):
        average[name].copy_(now[name])


def _validation_is_due(state: TrainingState, settings: RunSettings) -> bool:
    """Return whether the newest step is one to validate after and has not been validated."""
    step, every = state.step, settings.validation.every
    is_one = step == settings.steps or (step > 0 and step % every == 0)
    return is_one and _CRITERION not in _figures(state)


def _validate(task: Task[Any], run: Path, state: TrainingState, writer: Any) -> None:
    """Validate the average in process 0 and keep it if it is the best so far (or any, the last)."""
    if not task.processes.first:
        return
    own = _copy(task.network)
    try:
        task.network.load_state_dict(state.average)
        task.network.eval()
        figures = {f"val/{name}": value for name, value in task.validate().items()}
    finally:
        task.network.load_state_dict(own)
    with interrupts_deferred():
        better = figures[_CRITERION] < state.best
        state.best = min(state.best, figures[_CRITERION])
        if better or task.settings.validation.keep == "last":
            save_weights(run / BEST, state.average)
        _log(writer, state, figures)


@contextmanager
def _log_writer(run: Path, processes: Processes) -> Iterator[Any]:
    """Give the TensorBoard log of the run in process 0, None in the others.

    What its thread fails to write is an error of the next call: the thread prints nothing.
    """
    if not processes.first:
        yield None
        return
    from torch.utils.tensorboard import SummaryWriter

    usual = threading.excepthook

    def hook(failure: threading.ExceptHookArgs) -> None:
        if not issubclass(failure.exc_type, OSError):
            usual(failure)

    threading.excepthook = hook
    try:
        with SummaryWriter(str(run / TENSORBOARD)) as writer:
            yield writer
    finally:
        threading.excepthook = usual
