"""Training TimeCycle: from episodes and a config to a run that can answer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch.nn import functional

from pliant.loaders import ClipDataset
from pliant.loaders.frame_store import FrameStore
from pliant.models.don.matcher import RUN_FACTS
from pliant.models.timecycle.cycles import cycle_losses, weighted_sum
from pliant.models.timecycle.guard import Guard, compare_with_trivial
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.network import TimeCycleNetwork
from pliant.models.timecycle.patches import draw_patches
from pliant.models.timecycle.settings import TimeCycleSettings
from pliant.models.timecycle.validation import (
    draw_stretches,
    errors_over_time,
    figures,
    track_with,
)
from pliant.models.training.checkpoint import BEST, load_best
from pliant.models.training.loop import Batch, LoopSettings, Progress, step_batches, train
from pliant.models.training.processes import Processes, joined_processes
from pliant.models.training.run_folder import open_run, run_facts, with_tier, write_json
from pliant.spec.dataset import Dataset

RESUMABLE = ("threads", "workers", "cache", "checkpoint_every", "propagation")
"""Settings that may differ when a run goes on: they change no step."""


class TimeCycleTask:
    """What `pliant.models.training.loop.train` needs to know of TimeCycle.

    Args:
        dataset: The dataset.
        settings: The config, its tier named.
        run: The run's folder.
        processes: Which process this is.
    """

    network: TimeCycleNetwork

    def __init__(
        self, dataset: Dataset, settings: TimeCycleSettings, run: Path, processes: Processes
    ) -> None:
        self.settings, self.processes = settings, processes
        size = (settings.width, settings.height)
        cache = run / "cache" if settings.cache else None
        self.clips = ClipDataset(
            dataset,
            settings.tier,
            settings.split,
            length=settings.clips.length,
            step=settings.clips.step,
            step_max=settings.clips.step_max,
            queries=1,
            size=size,
            seed=settings.seed,
            augmentation=settings.augment,
            cache=cache,
            limit=settings.limit or None,
        )
        held_out = FrameStore(dataset, settings.tier, settings.validation.split, size, cache=cache)
        self.stretches = draw_stretches(held_out, settings.validation, settings.seed)
        self.network = first_network(settings).to(processes.device)

    def batches(self, start: int, stop: int) -> Iterable[Batch]:
        """Return the batches of steps start to stop - 1 for this process."""
        return step_batches(self.clips, self.settings, self.processes, start, stop)

    def loss(
        self, batch: Batch, progress: float, generator: torch.Generator
    ) -> tuple[torch.Tensor, Mapping[str, torch.Tensor]]:
        """Return the loss of a batch and its named parts."""
        settings, device = self.settings, self.processes.device
        images = batch["image"].to(device, non_blocking=True)
        patches = draw_patches(
            images,
            batch["mask"].to(device, non_blocking=True),
            count=settings.clips.patches,
            cells=self.network.cells,
            choose=settings.clips.choose,
            turn_deg=settings.clips.turn_deg,
            recolour=settings.clips.recolour,
            generator=generator,
        )
        frozen = progress < settings.losses.freeze
        with torch.no_grad() if frozen else nullcontext():
            frames = self.encode(images.flatten(0, 1)).unflatten(0, images.shape[:2])
            cut = self.encode(patches.images).flatten(2).transpose(1, 2)
        parts = cycle_losses(
            self.network,
            frames[patches.clip],
            cut,
            patches.placement,
            patches.weight,
            settings.losses,
        )
        loss = weighted_sum(parts, settings.losses)
        return loss, {name: part.detach() for name, part in parts.items()}

    def encode(self, images: torch.Tensor) -> torch.Tensor:
        """Return unit descriptors of images (N, 3, H, W) at the run's precision."""
        half = self.settings.precision == "bfloat16"
        images = images.contiguous(memory_format=torch.channels_last)
        with torch.autocast(images.device.type, torch.bfloat16) if half else nullcontext():
            described = self.network.encoder(images)
        return functional.normalize(described.float(), dim=1)

    def validate(self) -> Mapping[str, float]:
        """Return the errors of tracked points, px of a picture 640 wide."""
        return figures(errors_over_time(track_with(self.matcher()), self.stretches))

    def matcher(self, facts: Mapping[str, Any] | None = None) -> TimeCycleMatcher:
        """Return a matcher around the network as it is."""
        return TimeCycleMatcher(self.network, self.settings, facts)

    def guard(self, matcher: TimeCycleMatcher) -> Guard:
        """Compare a matcher with the trivial answers and the weights the run began with."""
        untrained = first_network(self.settings).to(self.processes.device)
        return compare_with_trivial(
            matcher, TimeCycleMatcher(untrained, self.settings), self.stretches
        )


def first_network(settings: TimeCycleSettings) -> TimeCycleNetwork:
    """Return a network with the weights that a run with these settings begins with."""
    torch.manual_seed(settings.seed)
    network: TimeCycleNetwork = TimeCycleNetwork(settings).to(  # type: ignore[call-overload]
        memory_format=torch.channels_last  # which torch's type stub lacks
    )
    return network


def train_timecycle(
    dataset: Dataset,
    run: Path,
    settings: TimeCycleSettings,
    *,
    resume: bool = False,
    progress: Progress | None = None,
    stop_at: int | None = None,
) -> dict[str, Any]:
    """Train TimeCycle; afterwards `load_matcher(run)` answers.

    Under `torchrun` every process calls this with the same arguments; process 0 writes.

    Args:
        dataset: A dataset with episodes.
        run: The run's folder: new or empty, or with `resume` one that was begun.
        settings: The config.
        resume: Go on from the newest checkpoint.
        progress: Told after each step.
        stop_at: Stop after this many steps with a checkpoint, as an interruption would.

    Returns:
        The run's facts, as in `run.json`, with the validation figures and the guard.

    Raises:
        CallError: The config does not fit the dataset, or the folder is in use.
        TrainingError: Nothing to resume, another config than it began with, or divergence.
    """
    settings = replace(settings, tier=with_tier(settings.tier, dataset))
    if settings.threads:
        torch.set_num_threads(settings.threads)
    with joined_processes() as processes:
        if processes.first:
            open_run(run, settings, resume, RESUMABLE)
        task = TimeCycleTask(dataset, settings, run, processes)
        watched = settings.validation
        loop = LoopSettings.of(settings, watched.every, watched.patience)
        state = train(
            task,
            run,
            settings.optimiser,
            loop,
            processes,
            resume=resume,
            progress=progress,
            stop_at=stop_at,
        )
        facts = run_facts(dataset, settings, state.step, processes.world) | {
            "encoder": settings.encoder.name,
            "descriptor_dim": settings.encoder.dim,
        }
        if processes.first and (run / BEST).is_file():
            load_best(task.network, run)
            matcher = task.matcher(facts)
            guard = task.guard(matcher)
            facts["validation"] = figures(errors_over_time(track_with(matcher), task.stretches))
            facts["guard"] = guard.as_dict()
            write_json(run / RUN_FACTS, facts)
            from pliant.models.timecycle.report import write_timecycle_report

            write_timecycle_report(run, matcher, task.stretches, state.history, guard, facts)
    return facts
