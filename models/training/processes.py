"""The processes of a training under `torchrun`: gloo on CPU, NCCL on GPUs; devices and interrupts.

Ctrl-C is for the process that trains, between two steps; a launcher does not leave it alone.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from multiprocessing import resource_tracker

import torch
from torch import distributed, nn

from pliant.models.training.settings import Precision


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
    means = flat.split([gradient.numel() for gradient in gradients])
    for gradient, mean in zip(gradients, means, strict=True):
        gradient.copy_(mean.view_as(gradient))


def agree(value: float, processes: Processes) -> float:
    """Return process 0's value in every process (its decision to stop, for example)."""
    if processes.world == 1:
        return value
    tensor = torch.tensor([value], dtype=torch.float64, device=processes.device)
    distributed.broadcast(tensor, src=0)
    return float(tensor.item())


@cache
def bfloat16_is_native(device: str) -> bool:
    """Return whether a kind of device (`cpu`, `cuda`) has instructions for bfloat16.

    A CPU without them (AVX-512 BF16, AMX) imitates them, at a third of the speed of float32. A
    torch that cannot tell (before `torch.cpu.get_capabilities`) counts as one without.
    """
    if device == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    of_cpu: dict[str, bool] = getattr(torch.cpu, "get_capabilities", dict)()
    return any(of_cpu.get(name, False) for name in ("avx512_bf16", "amx_bf16"))


def halved(precision: Precision, device: str) -> bool:
    """Return whether networks run in bfloat16 at a run's setting on this kind of device."""
    return precision == "bfloat16" or (precision == "auto" and bfloat16_is_native(device))


@contextmanager
def interrupts_deferred() -> Iterator[None]:
    """Handle SIGINT and SIGTERM after the body instead of within it."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread handles signals
        return
    received: list[int] = []
    usual = {
        number: signal.signal(number, lambda number, _: received.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)
    if received:
        signal.raise_signal(received[0])


def stop_with_launcher() -> None:
    """Send this process SIGTERM once its parent has ended: a killed one stops no process itself."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def children_ignore_interrupts() -> Iterator[None]:
    """Let processes that the body starts ignore SIGINT; here it is handled after the body."""
    with interrupts_deferred():
        if sys.platform == "win32":  # processes inherit no signal mask there
            yield
            return
        resource_tracker.ensure_running()  # begun within, it would unblock the signal
        usual = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, usual)
