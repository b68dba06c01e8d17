"""Turned and scaled copies of frames, and where their cells come from."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch.nn import functional

_LARGEST_SCALE = 1.25


@dataclass(frozen=True)
class TurnedClips:
    """Clips of which every frame is turned and scaled in its own way, about its centre.

    Attributes:
        images: float (B, T, C, H, W); what comes in from outside repeats the border.
        mask: bool (B, T, H, W), the object, nothing outside.
        place: float (B, T, h w, 2), where each cell's centre of the original is in the copy,
            cells.
    """

    images: torch.Tensor
    mask: torch.Tensor
    place: torch.Tensor


def turned_copies(
    images: torch.Tensor, mask: torch.Tensor, generator: torch.Generator, stride: int
) -> TurnedClips:
    """Turn each frame by any angle and scale it by up to a quarter.

    Args:
        images: float (B, T, C, H, W).
        mask: bool (B, T, H, W).
        generator: Source of randomness, on the device of the images.
        stride: Pixels along a side of a cell.
    """
    flat = images.flatten(0, 1)
    count, _, height, width = flat.shape
    draws = 2 * torch.rand(count, 2, generator=generator, device=images.device) - 1
    angle, scale = draws[:, 0] * math.pi, _LARGEST_SCALE ** draws[:, 1]
    cos, sin = angle.cos(), angle.sin()
    turn = torch.stack([torch.stack([cos, -sin], -1), torch.stack([sin, cos], -1)], dim=1)
    half = torch.tensor([width / 2, height / 2], device=images.device)
    # A pixel at x of the copy, from the centre, shows the pixel turn' x / scale of the original.
    back = turn.transpose(1, 2) / scale[:, None, None] * (half / half[:, None])
    theta = functional.pad(back, (0, 1))
    grid = functional.affine_grid(theta, [count, 1, height, width], align_corners=False)
    moved = functional.grid_sample(flat, grid, padding_mode="border", align_corners=False)
    shown = mask.flatten(0, 1)[:, None].to(flat.dtype)
    covered = functional.grid_sample(shown, grid, mode="nearest", align_corners=False) > 0.5
    v, u = torch.meshgrid(
        torch.arange(height // stride, device=images.device) + 0.5,
        torch.arange(width // stride, device=images.device) + 0.5,
        indexing="ij",
    )
    cells = torch.stack([u, v], dim=-1).reshape(-1, 2) - half / stride
    place = scale[:, None, None] * (cells @ turn.transpose(1, 2)) + half / stride
    place = place.unflatten(0, images.shape[:2])
    return TurnedClips(moved.view_as(images), covered[:, 0].view_as(mask), place)
