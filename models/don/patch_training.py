"""Training of small networks that judge patches of images; a few minutes on one core."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import torch
from torch import nn

_BATCH: Final = 64
_RATE: Final = 4e-3


def fit_patches(
    network: nn.Module, loss: Callable[[torch.Tensor], torch.Tensor], count: int, *, epochs: int
) -> None:
    """Train a network on patches; draws with torch's seed.

    Args:
        network: Afterwards in evaluation mode.
        loss: Rows, int64 (n,) -> the network's loss on them, changed at random.
        count: Number of rows.
        epochs: Passes over all rows.
    """
    batches = max(1, count // _BATCH)
    optimiser = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=0.02)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, _RATE, total_steps=epochs * batches)
    for _ in range(epochs):
        for chosen in torch.randperm(count).tensor_split(batches):
            optimiser.zero_grad()
            loss(chosen).backward()
            optimiser.step()
            schedule.step()
    network.eval()


def rotations(angle: torch.Tensor) -> torch.Tensor:
    """Return the matrices that turn by angles (…,), rad, float (…, 2, 2)."""
    cosine, sine = angle.cos(), angle.sin()
    return torch.stack(
        [torch.stack([cosine, -sine], dim=-1), torch.stack([sine, cosine], dim=-1)], dim=-2
    )


def recoloured(picture: torch.Tensor) -> torch.Tensor:
    """Return patches (N, K, 3, h, w), 0 to 1, in other colours and with noise, all K alike."""
    count = len(picture)
    mixing = torch.eye(3) + 0.35 * torch.randn(count, 3, 3)
    mixing = torch.where(torch.rand(count, 1, 1) < 0.2, torch.full((3, 3), 1 / 3), mixing)
    picture = torch.einsum("nkchw,ndc->nkdhw", picture, mixing)
    return picture + torch.randn_like(picture) * 0.05 * torch.rand(count, 1, 1, 1, 1).square()
