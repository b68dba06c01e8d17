"""Training in several processes under `torchrun`: gloo on CPU, NCCL on GPUs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import distributed, nn

from pliant.models.training.interrupts import stop_with_launcher


@dataclass(frozen=True)
class Processes:
    """Which process this is.

    Attributes:
        rank: Its number; 0 writes files and draws the progress bar.
        world: How many there are.
        device: Where it computes.
    """

    rank: int
    world: int
    device: torch.device

    @property
    def first(self) -> bool:
        """True in the process that writes."""
        return self.rank == 0

    @property
    def device_name(self) -> str:
        """`cpu`, or the name of the GPU."""
        if self.device.type != "cuda":
            return self.device.type
        return torch.cuda.get_device_name(self.device)


@contextmanager
def joined_processes() -> Iterator[Processes]:
    """Join the processes that `torchrun` started, or be the only one.

    Yields:
        Which process this is; the group is left at the end.
    """
    world = int(os.environ.get("WORLD_SIZE", "1"))
    rank = int(os.environ.get("RANK", "0"))
    cuda = torch.cuda.is_available()
    local = int(os.environ.get("LOCAL_RANK", "0"))
    device = torch.device("cuda", local) if cuda else torch.device("cpu")
    if cuda:
        torch.cuda.set_device(device)
    if world == 1:
        yield Processes(0, 1, device)
        return
    if "TORCHELASTIC_RUN_ID" in os.environ:  # started by torchrun
        stop_with_launcher()
    distributed.init_process_group("nccl" if cuda else "gloo")
    try:
        yield Processes(rank, world, device)
    finally:
        distributed.destroy_process_group()


def average_gradients(parameters: list[nn.Parameter], processes: Processes) -> None:
    """Replace every gradient by its mean over the processes.

    One flat buffer and one all-reduce; a parameter without a gradient counts as zero, so that
    all processes always take part.

    Args:
        parameters: The same parameters in the same order in every process.
        processes: Which process this is.
    """
    if processes.world == 1:
        return
    for parameter in parameters:
        if parameter.grad is None:
            parameter.grad = torch.zeros_like(parameter)
    gradients = [parameter.grad for parameter in parameters if parameter.grad is not None]
    flat = torch.cat([gradient.flatten() for gradient in gradients])
    distributed.all_reduce(flat)
    flat /= processes.world
    start = 0
    for gradient in gradients:
        stop = start + gradient.numel()
        gradient.copy_(flat[start:stop].view_as(gradient))
        start = stop


def agree(value: float, processes: Processes) -> float:
    """Return process 0's value in every process (its decision to stop, for example)."""
    if processes.world == 1:
        return value
    tensor = torch.tensor([value], dtype=torch.float64, device=processes.device)
    distributed.broadcast(tensor, src=0)
    return float(tensor.item())
