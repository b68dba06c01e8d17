"""Small squares of an image around places, turned to a direction, and networks that judge them."""

from __future__ import annotations

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
