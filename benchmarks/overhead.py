"""What a training step costs beyond its network."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import torch

from pliant.models.don.trainer import DonTask
from pliant.models.timecycle.trainer import TimeCycleTask


def overhead_ratio(
    task: DonTask | TimeCycleTask, rounds: int, bare: Callable[[Any], Callable[[], torch.Tensor]]
) -> float:
    """Return CPU time of a whole step over that of its network alone, the median of rounds.

    Args:
        task: A training, whose frames are in the store.
        rounds: Steps to measure, after a first one that warms up.
        bare: Takes a batch and returns what is measured: the network with a loss of one sum.
    """
    generator = torch.Generator().manual_seed(0)
    ratios = []
    for step in range(rounds + 1):
        started = time.process_time()
        batch = next(iter(task.batches(step, step + 1)))
        loss, _ = task.loss(batch, 0.0, generator)
        loss.backward()
        whole = time.process_time() - started
        alone = bare(batch)
        started = time.process_time()
        alone().backward()
        ratios.append(whole / (time.process_time() - started))
        task.network.zero_grad(set_to_none=True)
    return statistics.median(ratios[1:])
