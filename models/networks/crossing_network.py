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

from pliant.models.networks.patches import judging_layers, normalised, patches, steps
from pliant.spec.arrays import Float32Array, FloatArray

_REACH: Final = 4.0  # half the side of a patch, in half widths of the rope


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
    unit = np.broadcast_to(np.asarray(half_px, np.float64), (len(place_px),))
    both = [np.repeat(each, 2, axis=0) for each in (place_px, unit)]
    seen = patches(picture, both[0], ways.reshape(-1, 2), _REACH * both[1])
    sine = ways[:, 0, 0] * ways[:, 1, 1] - ways[:, 0, 1] * ways[:, 1, 0]
    turn = np.arctan2(sine, (ways[:, 0] * ways[:, 1]).sum(axis=1))
    seen = seen.view(-1, 2, *seen.shape[1:])
    return CrossingPatches(seen, torch.from_numpy(np.stack([turn, -turn], 1)).float())


class CrossingNetwork(nn.Module):
    """Log odds that the first strand of a crossing is on top."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = judging_layers(3 + 2)

    def forward(self, patches: CrossingPatches) -> torch.Tensor:
        """Return log odds, float (N,)."""
        picture = normalised(patches.picture.flatten(0, 1))
        looks = self.layers(torch.cat([picture, _strands(patches.angle.flatten())], dim=1))
        first, second = looks.view(-1, 2).unbind(dim=1)
        return first - second


def _strands(angle: torch.Tensor) -> torch.Tensor:
    """Return how near each pixel is to the strand along x and to the other: (N, 2, side, side)."""
    along = torch.from_numpy(steps(_REACH)).float()
    y, x = torch.meshgrid(along, along, indexing="ij")
    sine, cosine = angle.sin()[:, None, None], angle.cos()[:, None, None]
    other = (cosine * y - sine * x).square()
    return torch.exp(-torch.stack([y.square().expand_as(other), other], dim=1) / 2)
