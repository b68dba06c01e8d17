"""Training batches without a dataset: simulated, rendered and collated in worker processes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import torch
from torch.utils.data import IterableDataset, default_collate, get_worker_info

from pliant.loaders import PairDataset, StepOrder


class PairStream(IterableDataset[dict[str, torch.Tensor]]):
    """Batches of a `PairDataset`, step after step; the order does not depend on the workers.

    Each worker process opens its own renderer. With Blender's styles or a GPU give the loader
    `multiprocessing_context="spawn"`.

    Args:
        samples: The samples; those of `pliant.stream` read simulated frames.
        order: Which samples each step takes.

    Attributes:
        samples: The samples.

    Examples:
        >>> from torch.utils.data import DataLoader
        >>> rope = {"tiers": ["rope"], "splits": {"train": 2}, "style": "raster", "width": 160}
        >>> stream = pliant.stream(rope | {"height": 120}, steps=2)
        >>> [tuple(batch["image"].shape) for batch in DataLoader(stream, batch_size=None)]
        [(8, 2, 3, 120, 160), (8, 2, 3, 120, 160)]
    """

    def __init__(self, samples: PairDataset, order: StepOrder) -> None:
        self.samples, self._order = samples, order

    def __len__(self) -> int:
        return len(self._order)

    def __iter__(self) -> Iterator[dict[str, torch.Tensor]]:
        worker = get_worker_info()
        first, of = (worker.id, worker.num_workers) if worker else (0, 1)
        for numbers in islice(self._order, first, None, of):  # a loader takes turns
            yield default_collate([self.samples[number] for number in numbers])
