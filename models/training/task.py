"""What the training loop needs to know of a method: its network, samples, loss and validation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic

import torch
from torch import nn
from torch.utils.data import DataLoader
from torch.utils.data import Dataset as TorchDataset

from pliant.loaders import FrameStore, StepOrder
from pliant.models.training.processes import Processes, children_ignore_interrupts, halved
from pliant.models.training.settings import Chosen
from pliant.spec.dataset import Dataset

Batch = Mapping[str, torch.Tensor]


class Task(ABC, Generic[Chosen]):
    """A method that is trained; the constructor of a subclass also sets `network` and `samples`.

    Attributes:
        network: The network.
        samples: Training samples; sample number n depends on the seed and n alone.
        datasets: What it is trained on, the run's own dataset first.
        answering: The setting that says how the result answers, which changes no step.

    Args:
        dataset: The dataset.
        settings: The config, its tier named.
        run: The run's folder.
        processes: Which process this is.
    """

    network: nn.Module
    samples: TorchDataset[dict[str, torch.Tensor]]
    answering: ClassVar[str]

    def __init__(self, dataset: Dataset, settings: Chosen, run: Path, processes: Processes) -> None:
        self.dataset, self.settings, self.processes = dataset, settings, processes
        self.datasets: Sequence[Dataset] = (dataset,)
        self.size = (settings.width, settings.height)
        folder = Path(settings.cache_dir) if settings.cache_dir else run / "cache"
        self._cache = folder if settings.cache else None
        split = settings.validation.split
        self.held_out = FrameStore(dataset, settings.tier, split, self.size, cache=self._cache)

    def training_frames(self, dataset: Dataset, tier: str) -> FrameStore:
        """Return the frames of a dataset's tier to train on."""
        limit = self.settings.limit or None
        split = self.settings.split
        return FrameStore(dataset, tier, split, self.size, cache=self._cache, limit=limit)

    def batches(self, start: int, stop: int) -> Iterator[Batch]:
        """Return the batches of steps start to stop - 1 for this process."""
        rank, world = self.processes.rank, self.processes.world
        order = StepOrder(self.settings.batch, start, stop, rank=rank, world=world)
        loader: DataLoader[Any] = DataLoader(
            self.samples,
            batch_sampler=order,
            num_workers=self.settings.workers,
            pin_memory=self.processes.device.type == "cuda",
            multiprocessing_context="spawn" if self.settings.workers else None,
        )
        with children_ignore_interrupts():
            return iter(loader)

    def precision(self) -> torch.autocast:
        """Return the context in which the network runs at the run's precision."""
        kind = self.processes.device.type
        half = halved(self.settings.precision, kind)
        return torch.autocast(kind, torch.bfloat16, enabled=half)

    @abstractmethod
    def loss(
        self, batch: Batch, progress: float, generator: torch.Generator
    ) -> tuple[torch.Tensor, Mapping[str, torch.Tensor]]:
        """Return the loss of a batch and its named parts.

        Args:
            batch: From `batches`, on the device of `processes`.
            progress: Share of the training done, 0 to 1.
            generator: Source of randomness of the step.
        """

    @abstractmethod
    def validate(self) -> Mapping[str, float]:
        """Return figures of the network as it is; the lowest `criterion_px` is the best."""

    @abstractmethod
    def facts(self) -> dict[str, Any]:
        """Return what `run.json` records about the method."""

    @abstractmethod
    def finish(
        self, run: Path, history: Sequence[Mapping[str, float]], facts: dict[str, Any]
    ) -> None:
        """Measure the trained network, and write `run.json` and the report.

        Args:
            run: The run's folder.
            history: The logged figures.
            facts: The run's facts; the final figures are added to them.
        """
