"""Which of two crossing strands is on top, seen from a small patch of the image.

A patch is sampled twice, turned so that each strand in turn runs along its x axis, in units of
half the rope's width. The network gives each a number, how much the strand along x looks like the
upper one, and the difference of the two is the log odds: exchanging the strands changes its sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from pliant.spec.arrays import Float32Array, FloatArray

PATCH: Final = 32
"""Pixels along each side of a patch."""

_REACH: Final = 4.0  # half the side of a patch, in half widths of the rope
_FLATTEST: Final = 4.0 / 255


@dataclass(frozen=True)
class CrossingPatches:
    """The surroundings of N crossings.

    Attributes:
        picture: float (N, 2, 3, PATCH, PATCH), colours from 0 to 1, turned to the first and to
            the second strand.
        angle: float (N, 2), rad, from the strand along x to the other one.
    """

    picture: torch.Tensor
    angle: torch.Tensor

    def __len__(self) -> int:
        return len(self.angle)

    def rows(self, chosen: torch.Tensor) -> CrossingPatches:
        """Return some of the crossings."""
        return CrossingPatches(self.picture[chosen], self.angle[chosen])

    @classmethod
    def joined(cls, parts: list[CrossingPatches]) -> CrossingPatches:
        """Return the crossings of several images, at least one."""
        pictures = torch.cat([part.picture for part in parts])
        return cls(pictures, torch.cat([part.angle for part in parts]))


def crossing_patches(
    picture: Float32Array, place_px: FloatArray, ways: FloatArray, half_px: float | FloatArray
) -> CrossingPatches:
    """Sample the surroundings of crossings.

    Args:
        picture: float32 (H, W, 3), colours from 0 to 1.
        place_px: float64 (N, 2).
        ways: float64 (N, 2, 2), unit vectors along both strands.
        half_px: Half the rope's width, of all or of each, (N,).
    """
    steps = ((np.arange(PATCH) + 0.5) / PATCH * 2 - 1) * _REACH
    across = np.stack([-ways[..., 1], ways[..., 0]], axis=-1)
    unit = np.broadcast_to(np.asarray(half_px, np.float64), (len(place_px),))[:, None, None]
    grid = (
        place_px[:, None, None, None]
        + (unit * ways)[:, :, None, None] * steps[None, None, None, :, None]
        + (unit * across)[:, :, None, None] * steps[None, None, :, None, None]
    )  # (N, 2, rows, columns, 2)
    height, width = picture.shape[:2]
    places = torch.from_numpy((grid * 2 / [width, height] - 1).astype(np.float32))
    planes = torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1)))[None]
    count = len(place_px)
    sampled = functional.grid_sample(
        planes, places.view(1, -1, PATCH, 2), padding_mode="border", align_corners=False
    )
    patches = sampled[0].view(-1, count, 2, PATCH, PATCH).permute(1, 2, 0, 3, 4)
    sine = ways[:, 0, 0] * ways[:, 1, 1] - ways[:, 0, 1] * ways[:, 1, 0]
    turn = np.arctan2(sine, (ways[:, 0] * ways[:, 1]).sum(axis=1))
    return CrossingPatches(patches, torch.from_numpy(np.stack([turn, -turn], 1)).float())


class CrossingNetwork(nn.Module):
    """Log odds that the first strand of a crossing is on top."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        channels = 3 + 2
        for width, stride in ((16, 1), (24, 2), (32, 2), (48, 2)):
            layers += [nn.Conv2d(channels, width, 3, stride, 1), nn.SiLU()]
            channels = width
        side = PATCH // 8
        self.layers = nn.Sequential(
            *layers,
            nn.Flatten(),
            nn.Dropout(0.2),
            nn.Linear(channels * side * side, 32),
            nn.SiLU(),
            nn.Linear(32, 1),
        )

    def forward(self, patches: CrossingPatches) -> torch.Tensor:
        """Return log odds, float (N,)."""
        picture = _normalised(patches.picture.flatten(0, 1))
        looks = self.layers(torch.cat([picture, _strands(patches.angle.flatten())], dim=1))
        first, second = looks.view(-1, 2).unbind(dim=1)
        return first - second


def _normalised(picture: torch.Tensor) -> torch.Tensor:
    grey = picture.mean(dim=1, keepdim=True)
    planes = torch.cat([grey, picture[:, :1] - grey, picture[:, 2:] - grey], dim=1)
    spread = grey.flatten(1).std(dim=1)[:, None, None, None] + _FLATTEST
    return (planes - planes.mean(dim=(2, 3), keepdim=True)) / spread


def _strands(angle: torch.Tensor) -> torch.Tensor:
    """Return how near each pixel is to the strand along x and to the other: (N, 2, side, side)."""
    steps = ((torch.arange(PATCH) + 0.5) / PATCH * 2 - 1) * _REACH
    y, x = torch.meshgrid(steps, steps, indexing="ij")
    sine, cosine = angle.sin()[:, None, None], angle.cos()[:, None, None]
    other = (cosine * y - sine * x).square()
    along = y.square().expand_as(other)
    return torch.exp(-torch.stack([along, other], dim=1) / 2)
