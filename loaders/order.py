"""The order of samples: seeded, shared out over processes, and resumable at any step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch.utils.data import Dataset as TorchDataset
from torch.utils.data import Sampler

from pliant.spec.calls import check_whole


class DrawnSamples(TorchDataset[dict[str, torch.Tensor]]):
    """A dataset that draws sample n from the seed and n alone, for any n >= 0."""

    def __iter__(self) -> Iterator[dict[str, torch.Tensor]]:
        """Return the samples of one epoch: by their numbers alone, iteration would never end."""
        return (self[number] for number in range(len(self)))

    def __len__(self) -> int:
        """Return how many samples an epoch is said to have."""
        raise NotImplementedError


class StepOrder(Sampler[list[int]]):
    """Batches of sample numbers, step after step; step k never depends on where a run began.

    The datasets here draw sample n from the seed and n alone, so handing out numbers is all
    that an order has to do. Process r of R takes every R-th batch-sized slice.

    Args:
        batch: Samples a step and process, >= 1.
        start: First step.
        stop: Step to end before.
        rank: This process's number.
        world: Number of processes.

    Examples:
        >>> list(pliant.loaders.StepOrder(batch=2, start=3, stop=5))
        [[6, 7], [8, 9]]
    """

    def __init__(self, batch: int, start: int, stop: int, *, rank: int = 0, world: int = 1) -> None:
        check_whole("batch", batch, 1)
        check_whole("start", start)
        check_whole("stop", stop)
        check_whole("world", world, 1)
        check_whole("rank", rank, 0, world - 1)
        self.batch, self.start, self.stop = batch, start, stop
        self.rank, self.world = rank, world

    def __iter__(self) -> Iterator[list[int]]:
        for step in range(self.start, self.stop):
            first = (step * self.world + self.rank) * self.batch
            yield list(range(first, first + self.batch))

    def __len__(self) -> int:
        return max(0, self.stop - self.start)


def sample_generator(seed: int, sample: int, stream: int = 0) -> np.random.Generator:
    """Return the random generator of one sample.

    Args:
        seed: The run's seed, >= 0.
        sample: The sample's number, >= 0.
        stream: Which dataset (training 0, validation 1 …).

    Raises:
        IndexError: The number is negative.
        CallError: It is not a number.
    """
    check_number(sample)
    return np.random.default_rng(np.random.SeedSequence([seed, stream, sample]))


def check_number(sample: object) -> None:
    """Refuse what is not the number of a sample.

    Raises:
        IndexError: The number is negative.
        CallError: It is not a number.
    """
    if isinstance(sample, int) and sample < 0:
        raise IndexError(f"sample {sample}: samples are numbered from 0")
    check_whole("index", sample)
