"""The training loop, whatever is trained: steps, schedule, checkpoints, validation, early stop.

A `Task` says what a batch's loss is and how good the network is; the loop does the rest. All
randomness of a step comes from the seed and the step's number, so a resumed run takes the
same steps as one that was never stopped.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import nn
from torch.utils.data import DataLoader
from torch.utils.data import Dataset as TorchDataset

from pliant.loaders import StepOrder
from pliant.models.settings import OptimiserSettings, RunSettings
from pliant.models.training.checkpoint import (
    BEST,
    TrainingState,
    Weights,
    latest_checkpoint,
    read_checkpoint,
    save_checkpoint,
    save_weights,
)
from pliant.models.training.muon import Muon, is_matrix
from pliant.models.training.processes import Processes, agree, average_gradients
from pliant.spec.errors import TrainingError

logger = logging.getLogger(__name__)

Batch = Mapping[str, torch.Tensor]
Progress = Callable[[int, Mapping[str, float]], None]
"""Called after each step with the steps done and the latest figures."""

_LOG_EVERY = 10


class Task(Protocol):
    """What is trained."""

    @property
    def network(self) -> nn.Module:
        """The network."""
        ...

    def batches(self, start: int, stop: int) -> Iterable[Batch]:
        """Return the batches of steps start to stop - 1 for this process."""
        ...

    def loss(
        self, batch: Batch, progress: float, generator: torch.Generator
    ) -> tuple[torch.Tensor, Mapping[str, torch.Tensor]]:
        """Return the loss of a batch and its named parts."""
        ...

    def validate(self) -> Mapping[str, float]:
        """Return figures of the network as it is; the lowest `criterion_px` is the best."""
        ...


@dataclass(frozen=True)
class LoopSettings:
    """How long, and when what happens.

    Attributes:
        steps: Optimiser steps.
        seed: Seed of each step's own draws.
        checkpoint_every: Steps between checkpoints.
        validate_every: Steps between validations.
        patience: Validations without improvement after which to stop; 0 never stops.
        keep_last: Whether the last validated weights answer, not the best ones.
    """

    steps: int
    seed: int
    checkpoint_every: int
    validate_every: int
    patience: int
    keep_last: bool = False

    @classmethod
    def of(
        cls, settings: RunSettings, validate_every: int, patience: int, *, keep_last: bool = False
    ) -> LoopSettings:
        """Return what a run's settings say of its loop."""
        return cls(
            steps=settings.steps,
            seed=settings.seed,
            checkpoint_every=settings.checkpoint_every,
            validate_every=validate_every,
            patience=patience,
            keep_last=keep_last,
        )


def step_batches(
    samples: TorchDataset[Batch],
    settings: RunSettings,
    processes: Processes,
    start: int,
    stop: int,
) -> DataLoader[Batch]:
    """Return the batches of steps start to stop - 1 for a process.

    Args:
        samples: Sample number n depends on its seed and n alone.
        settings: Batch and loader processes.
        processes: Which process this is, and where it trains.
        start: First step.
        stop: Step after the last.
    """
    order = StepOrder(settings.batch, start, stop, rank=processes.rank, world=processes.world)
    return DataLoader(
        samples,
        batch_sampler=order,
        num_workers=settings.workers,
        pin_memory=processes.device.type == "cuda",
        multiprocessing_context="spawn" if settings.workers else None,
    )


def learning_rate(settings: OptimiserSettings, step: int, steps: int) -> float:
    """Return the learning rate of a step.

    Args:
        settings: The schedule.
        step: Number of the step, from 0.
        steps: Steps in all.
    """
    rate = settings.learning_rate
    if step < settings.warmup:
        return rate * (step + 1) / settings.warmup
    if settings.schedule == "cosine":
        share = (step - settings.warmup) / max(1, steps - settings.warmup)
        return rate * 0.5 * (1 + math.cos(math.pi * min(1.0, share)))
    if settings.schedule == "step":
        return float(rate * settings.step_factor ** (step // settings.step_every))
    return rate


def make_optimiser(network: nn.Module, settings: OptimiserSettings) -> torch.optim.Optimizer:
    """Return the optimiser of a network's trainable parameters.

    Weights decay, biases and norms do not. Each group holds `ratio`, its rate over
    `settings.learning_rate`.

    Args:
        network: What is trained.
        settings: Which optimiser.
    """
    parameters = [p for p in network.parameters() if p.requires_grad]
    muon = settings.kind == "muon"
    matrices = [p for p in parameters if muon and is_matrix(p)]
    weights = [p for p in parameters if p.dim() > 1 and not (muon and is_matrix(p))]
    vectors = [p for p in parameters if p.dim() <= 1]
    groups = [
        {"params": weights, "weight_decay": settings.weight_decay, "ratio": 1.0},
        {"params": vectors, "weight_decay": 0.0, "ratio": 1.0},
    ]
    betas = (settings.beta1, 0.999)
    if not muon:
        return torch.optim.AdamW(groups, lr=settings.learning_rate, betas=betas)
    ratio = settings.matrix_rate / settings.learning_rate
    groups.append({"params": matrices, "weight_decay": 0.0, "ratio": ratio, "muon": True})
    return Muon(groups, betas=betas)


def train(
    task: Task,
    run: Path,
    optimiser_settings: OptimiserSettings,
    loop: LoopSettings,
    processes: Processes,
    *,
    resume: bool = False,
    progress: Progress | None = None,
    stop_at: int | None = None,
) -> TrainingState:
    """Train, or go on training.

    Args:
        task: What is trained.
        run: The run's folder, which exists.
        optimiser_settings: The optimiser.
        loop: How long, and when what happens.
        processes: Which process this is.
        resume: Go on from the newest checkpoint.
        progress: Told after each step.
        stop_at: Stop after this many steps with a checkpoint, as an interruption would.

    Returns:
        Where the run stands; `average` are the weights to answer with.

    Raises:
        TrainingError: The loss is no longer finite, or there is no checkpoint to resume.
    """
    network = task.network
    parameters = [p for p in network.parameters() if p.requires_grad]
    optimiser = make_optimiser(network, optimiser_settings)
    state = _start(network, optimiser, run, resume)
    generator = torch.Generator(device=processes.device)
    stop = loop.steps if stop_at is None else min(stop_at, loop.steps)
    with _log_writer(run, processes) as writer:
        try:
            for step, batch in enumerate(task.batches(state.step, stop), start=state.step):
                network.train()
                rate = learning_rate(optimiser_settings, step, loop.steps)
                for group in optimiser.param_groups:
                    group["lr"] = rate * group["ratio"]
                generator.manual_seed((loop.seed * 1_000_003 + step) * 1_009 + processes.rank)
                loss, parts = task.loss(batch, step / loop.steps, generator)
                optimiser.zero_grad(set_to_none=True)
                loss.backward()
                average_gradients(parameters, processes)
                limit = optimiser_settings.clip_norm or math.inf
                norm = nn.utils.clip_grad_norm_(parameters, limit)
                if not bool(torch.isfinite(norm)):
                    raise TrainingError(
                        "the gradient is no longer finite",
                        where=f"step {step}",
                        found=f"loss {float(loss.detach())}",
                        fix="Lower optimiser.learning_rate or use precision: float32",
                    )
                optimiser.step()
                state.step = step + 1
                _update_average(state.average, network, optimiser_settings.average, state.step)
                done = state.step == loop.steps
                figures = {name: float(value) for name, value in parts.items()}
                logged: dict[str, float] = {}
                if state.step % _LOG_EVERY == 0 or done:
                    logged = {
                        "loss": float(loss.detach()),
                        "learning_rate": optimiser.param_groups[0]["lr"],
                        "gradient_norm": float(norm),
                        **figures,
                    }
                if state.step % loop.validate_every == 0 or done:
                    logged |= _validate(task, run, state, loop, processes)
                if logged:
                    state.history.append({"step": state.step, **logged})
                    for name, value in logged.items():
                        writer(name, value, state.step)
                ended = bool(loop.patience) and state.waited >= loop.patience
                ended = bool(agree(float(ended), processes))
                if (
                    state.step % loop.checkpoint_every == 0 or done or ended or state.step == stop
                ) and processes.first:
                    _save(run, state, network, optimiser)
                if progress is not None:
                    progress(state.step, logged)
                if ended:
                    logger.info("no better for %d validations: stopped", loop.patience)
                    break
        except KeyboardInterrupt:
            if processes.first:
                _save(run, state, network, optimiser)
            raise
    return state


def _start(
    network: nn.Module, optimiser: torch.optim.Optimizer, run: Path, resume: bool
) -> TrainingState:
    if not resume:
        return TrainingState(0, {}, _copy(network.state_dict()), {})
    folder = latest_checkpoint(run)
    if folder is None:
        raise TrainingError(
            "there is no checkpoint to resume", path=run, fix="Start it without --resume."
        )
    state = read_checkpoint(folder)
    network.load_state_dict(state.weights)
    optimiser.load_state_dict(state.optimiser)
    device = next(network.parameters()).device
    state.average = {name: tensor.to(device) for name, tensor in state.average.items()}
    return state


def _save(
    run: Path, state: TrainingState, network: nn.Module, optimiser: torch.optim.Optimizer
) -> None:
    state.weights = _copy(network.state_dict())
    state.optimiser = optimiser.state_dict()
    save_checkpoint(run, state)


def _copy(weights: Mapping[str, torch.Tensor]) -> Weights:
    return {name: tensor.detach().clone() for name, tensor in weights.items()}


@torch.no_grad()
def _update_average(average: Weights, network: nn.Module, keep: float, step: int) -> None:
    """Move the average towards the weights; early on it forgets faster, so it starts unbiased."""
    keep = min(keep, (1 + step) / (10 + step)) if keep else 0.0
    for name, tensor in network.state_dict().items():
        if tensor.is_floating_point():
            average[name].lerp_(tensor, 1 - keep)
        else:
            average[name].copy_(tensor)


def _validate(
    task: Task, run: Path, state: TrainingState, loop: LoopSettings, processes: Processes
) -> dict[str, float]:
    """Validate the average in process 0 and keep it if it is the best so far (or any, the last)."""
    if not processes.first:
        return {}
    own = _copy(task.network.state_dict())
    task.network.load_state_dict(state.average)
    task.network.eval()
    figures = {f"val/{name}": value for name, value in task.validate().items()}
    task.network.load_state_dict(own)
    better = figures["val/criterion_px"] < state.best
    if better:
        state.best, state.waited = figures["val/criterion_px"], 0
    else:
        state.waited += 1
    if better or loop.keep_last:
        save_weights(run / BEST, state.average)
    return figures


class _TensorBoard(AbstractContextManager["_TensorBoard"]):
    """Writes scalars for TensorBoard."""

    def __init__(self, folder: Path) -> None:
        from torch.utils.tensorboard import SummaryWriter

        self._writer: Any = SummaryWriter(str(folder))

    def __call__(self, name: str, value: float, step: int) -> None:
        self._writer.add_scalar(name, value, step)

    def __exit__(self, *_: object) -> None:
        self._writer.close()


def _log_writer(
    run: Path, processes: Processes
) -> AbstractContextManager[Callable[[str, float, int], None]]:
    if processes.first:
        return _TensorBoard(run / "tensorboard")
    return nullcontext(lambda name, value, step: None)
