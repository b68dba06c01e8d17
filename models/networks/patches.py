"""Small squares of an image around places, turned to a direction, and networks that judge them.

Such a network is trained in a few minutes on one core.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from pliant.spec.arrays import Float32Array, FloatArray

PATCH: Final = 32
"""Pixels along each side of a patch."""

_FLATTEST: Final = 4.0 / 255


def steps(reach: float, side: int = PATCH) -> FloatArray:
    """Return the offsets of a patch's pixels from its middle along one side, float64 (side,).

    Args:
        reach: Half its side, in any unit.
        side: Its pixels.
    """
    return ((np.arange(side) + 0.5) / side * 2 - 1) * reach


def patches(
    image: Float32Array,
    place_px: FloatArray,
    directions: FloatArray,
    reach_px: FloatArray,
    side: int = PATCH,
) -> torch.Tensor:
    """Sample squares of an image.

    Args:
        image: float32 (H, W, C).
        place_px: float64 (N, 2), their middles.
        directions: float64 (N, 2), unit vectors along their x axes.
        reach_px: float64 (N,), half their sides.
        side: Their pixels along each side.

    Returns:
        float32 (N, C, side, side).
    """
    along = steps(1.0, side)
    across = np.stack([-directions[:, 1], directions[:, 0]], axis=-1)
    unit = reach_px[:, None, None, None]
    grid = (
        place_px[:, None, None]
        + unit * directions[:, None, None] * along[None, None, :, None]
        + unit * across[:, None, None] * along[None, :, None, None]
    )  # (N, rows, columns, 2)
    height, width, channels = image.shape
    places = torch.from_numpy((grid * 2 / [width, height] - 1).astype(np.float32))
    planes = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))[None]
    sampled = functional.grid_sample(
        planes, places.view(1, -1, side, 2), padding_mode="border", align_corners=False
    )
    return sampled[0].view(channels, -1, side, side).transpose(0, 1)


def normalised(picture: torch.Tensor) -> torch.Tensor:
    """Return grey, and red and blue less grey, of patches, with mean 0 and the grey's spread 1.

    Args:
        picture: float (N, 3, side, side), 0 to 1.
    """
    grey = picture.mean(dim=1, keepdim=True)
    planes = torch.cat([grey, picture[:, :1] - grey, picture[:, 2:] - grey], dim=1)
    spread = grey.flatten(1).std(dim=1)[:, None, None, None] + _FLATTEST
    return (planes - planes.mean(dim=(2, 3), keepdim=True)) / spread


def judging_layers(channels: int, numbers: int = 1) -> nn.Sequential:
    """Return layers that give each patch, (N, channels, PATCH, PATCH), numbers: (N, numbers)."""
    layers: list[nn.Module] = []
    for width, stride in ((16, 1), (24, 2), (32, 2), (48, 2)):
        layers += [nn.Conv2d(channels, width, 3, stride, 1), nn.SiLU()]
        channels = width
    side = PATCH // 8
    return nn.Sequential(
        *layers,
        nn.Flatten(),
        nn.Dropout(0.2),
        nn.Linear(channels * side * side, 32),
        nn.SiLU(),
        nn.Linear(32, numbers),
    )


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
