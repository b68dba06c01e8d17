"""Which of two crossing strands is seen, place by place, in a small patch of the image.

A patch is turned so that the first strand runs along its x axis, in units of half the rope's
width. Next to its colours the network sees how far each pixel is from the middle of either strand.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import torch

from pliant.models.networks.patches import normalised, patches, steps
from pliant.models.networks.unet import UNet
from pliant.spec.arrays import Float32Array, FloatArray

SIDE: Final = 48
"""Pixels along each side of a patch."""

REACH: Final = 3.0
"""Half the side of a patch, in half widths of the rope."""

_FARTHEST: Final = 3.0  # distances beyond it, in half widths, look alike


def crossing_planes(
    picture: Float32Array,
    place_px: FloatArray,
    directions: FloatArray,
    lines_px: FloatArray,
    half_px: float,
) -> torch.Tensor:
    """Sample the surroundings of crossings.

    Args:
        picture: float32 (H, W, 3), colours from 0 to 1.
        place_px: float64 (N, 2), the crossings.
        directions: float64 (N, 2), unit vectors along the first strand.
        lines_px: float64 (N, 2, L, 2), the middles of both strands around the crossing.
        half_px: Half the rope's width.

    Returns:
        float32 (N, 5, SIDE, SIDE): colours, and the distances to either middle in half widths.
    """
    seen = patches(picture, place_px, directions, np.full(len(place_px), REACH * half_px), SIDE)
    axes = np.stack([directions, np.stack([-directions[:, 1], directions[:, 0]], axis=1)], axis=1)
    turned = np.einsum("nij,nklj->nkli", axes, (lines_px - place_px[:, None, None]) / half_px)
    along = steps(REACH, SIDE)
    grid = torch.from_numpy(np.stack(np.meshgrid(along, along), axis=-1)).float()
    lines = torch.from_numpy(turned).float()
    gaps = distances(grid.expand(len(lines), -1, -1, -1), lines)
    return torch.cat([seen, gaps], dim=1)


def distances(places: torch.Tensor, lines: torch.Tensor) -> torch.Tensor:
    """Return how far places (N, h, w, 2) are from polylines (N, K, L, 2), float (N, K, h, w)."""
    start, step = lines[:, :, :-1], lines.diff(dim=2)
    apart = places.flatten(1, 2)[:, None, :, None] - start[:, :, None]  # (N, K, hw, L - 1, 2)
    step = step[:, :, None]
    share = (apart * step).sum(-1) / (step.square().sum(-1) + 1e-9)
    nearest = apart - share.clamp(0, 1)[..., None] * step
    gap = nearest.square().sum(-1).amin(-1).sqrt()
    return gap.unflatten(2, (places.shape[1], places.shape[2]))


class CrossingNetwork(UNet):
    """Log odds that the first strand of a crossing is seen and not the second one."""

    def __init__(self) -> None:
        super().__init__(3 + 2, 1, widths=(24, 32, 48), global_blocks=0, patch=2)

    def forward(self, planes: torch.Tensor) -> torch.Tensor:
        """Look at patches by `crossing_planes`, (N, 5, h, w); returns log odds, float (N, h, w)."""
        gaps = _FARTHEST / 2 - planes[:, 3:].clamp(max=_FARTHEST)
        return super().forward(torch.cat([normalised(planes[:, :3]), gaps], dim=1))[:, 0]
