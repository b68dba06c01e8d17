"""Training TimeCycle: from episodes and a config to a run that can answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import torch

from pliant.loaders import ClipDataset
from pliant.models.timecycle.cycles import cycle_losses, weighted_sum
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.network import TimeCycleNetwork
from pliant.models.timecycle.patches import draw_patches
from pliant.models.timecycle.report import compare_with_trivial
from pliant.models.timecycle.settings import TimeCycleSettings
from pliant.models.timecycle.validation import (
    choose_readout,
    draw_stretches,
    errors_over_time,
    figures,
    track_with,
)
from pliant.models.timecycle.walk import walk_losses, warped_copies
from pliant.models.training.loop import RunOptions, train_task
from pliant.models.training.processes import Processes
from pliant.models.training.run_folder import RUN_FACTS, write_json, write_settings
from pliant.models.training.task import Batch, Task
from pliant.spec.dataset import Dataset


class TimeCycleTask(Task[TimeCycleSettings]):
    """TimeCycle as `train_task` trains it; see `Task`."""

    network: TimeCycleNetwork
    answering = "propagation"

    def __init__(
        self, dataset: Dataset, settings: TimeCycleSettings, run: Path, processes: Processes
    ) -> None:
        super().__init__(dataset, settings, run, processes)
        self.samples = ClipDataset(
            self.training_frames(dataset, settings.tier),
            length=settings.clips.length,
            step=settings.clips.step,
            step_max=settings.clips.step_max,
            queries=1,
            input=settings.clips.network_input,
            seed=settings.seed,
            augmentation=settings.augment,
        )
        self.stretches = draw_stretches(self.held_out, settings.validation, settings.seed)
        self.network = first_network(settings).to(processes.device)

    def loss(
        self, batch: Batch, progress: float, generator: torch.Generator
    ) -> tuple[torch.Tensor, Mapping[str, torch.Tensor]]:
        """Return the loss of a batch and its named parts; see `Task`."""
        settings = self.settings
        loss, parts = torch.zeros((), device=batch["image"].device), {}
        if settings.losses.any:
            parts = self._cycle_losses(batch, generator)
            loss = weighted_sum(parts, settings.losses)
        if settings.walk.weight > 0:
            walked = self._walk_losses(batch, generator)
            loss = loss + settings.walk.weight * (walked["direct"] + walked["walk"])
            parts = {**parts, **walked}
        return loss, {name: part.detach() for name, part in parts.items()}

    def _cycle_losses(self, batch: Batch, generator: torch.Generator) -> dict[str, torch.Tensor]:
        settings, images = self.settings, batch["image"]
        frames = self.encode(images.flatten(0, 1)).unflatten(0, images.shape[:2])
        clips, cells = settings.clips, self.network.cells
        patches = draw_patches(images, batch["mask"], cells, clips, generator, settings.stride)
        cut = self.encode(patches.images).flatten(2).transpose(1, 2)
        return cycle_losses(
            self.network,
            frames[patches.clip],
            cut,
            patches.placement,
            patches.weight,
            settings.losses,
        )

    def _walk_losses(self, batch: Batch, generator: torch.Generator) -> dict[str, torch.Tensor]:
        """Return the losses of walks from the last frame to the first one, or the other way."""
        images, mask, settings = batch["image"], batch["mask"], self.settings.walk
        ends = (
            (-1, 0) if torch.rand((), generator=generator, device=images.device) < 0.5 else (0, -1)
        )
        (frame, shown), (other, between) = ((images[:, t], mask[:, t]) for t in ends)
        a, b, m = (
            warped_copies(picture, covered, settings, generator)
            for picture, covered in ((frame, shown), (frame, shown), (other, between))
        )
        seen = torch.cat([a.images, m.images, b.images])
        with self.precision():
            described = self.network.encoder(seen.contiguous(memory_format=torch.channels_last))
        scale = self.network.encoder.scale
        return walk_losses(described.float().chunk(3), (a, b), m.mask, scale, settings, generator)

    def encode(self, images: torch.Tensor) -> torch.Tensor:
        """Return unit descriptors of images (N, C, H, W) at the run's precision."""
        with self.precision():
            return self.network.encode(images.contiguous(memory_format=torch.channels_last))

    def validate(self) -> Mapping[str, float]:
        """Return the errors of tracked points, px of a picture 640 wide."""
        matcher = TimeCycleMatcher(self.network, self.settings)
        return figures(errors_over_time(track_with(matcher), self.stretches))

    def read_out(self, matcher: TimeCycleMatcher) -> TimeCycleMatcher:
        """Return a matcher with the read-out that suits its encoder, where it is to be chosen."""
        if not self.settings.propagation.chosen:
            return matcher
        return matcher.read_by(choose_readout(matcher, self.stretches))

    def facts(self) -> dict[str, Any]:
        """Return what `run.json` records about the method."""
        network = self.settings.network
        return {"network": network.name, "descriptor_dim": network.descriptor_dim}

    def finish(
        self, run: Path, history: Sequence[Mapping[str, float]], facts: dict[str, Any]
    ) -> None:
        """Compare the network with the trivial answers and its first weights; see `Task`."""
        matcher = self.read_out(TimeCycleMatcher(self.network, self.settings, facts))
        write_settings(run, matcher.settings)
        first = first_network(self.settings).to(self.processes.device)
        untrained = self.read_out(TimeCycleMatcher(first, self.settings))
        guard = compare_with_trivial(matcher, untrained, self.stretches)
        facts["validation"] = figures(errors_over_time(track_with(matcher), self.stretches))
        facts["guard"] = guard.as_dict()
        write_json(run / RUN_FACTS, facts)
        from pliant.models.timecycle.report import write_timecycle_report

        write_timecycle_report(run, history, guard, facts, self.settings.propagation.chosen)


def first_network(settings: TimeCycleSettings) -> TimeCycleNetwork:
    """Return a network with the weights that a run with these settings begins with."""
    torch.manual_seed(settings.seed)
    network: TimeCycleNetwork = TimeCycleNetwork(settings).to(  # type: ignore[call-overload]
        memory_format=torch.channels_last  # which torch's type stub lacks
    )
    return network


def train_timecycle(
    dataset: Dataset, run: Path, settings: TimeCycleSettings, **options: Unpack[RunOptions]
) -> dict[str, Any]:
    """Train TimeCycle on a dataset with episodes; see `train_task`."""
    return train_task(TimeCycleTask, dataset, run, settings, options)
