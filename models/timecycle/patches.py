"""Choosing the patches of a clip: on the object where its mask may be seen, else where it moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch.nn import functional

from pliant.models.networks.descriptor_network import sample_descriptors
from pliant.models.timecycle.network import cell_grid, cut_patches, place
from pliant.models.timecycle.settings import ClipSettings

_STILL_SHARE = 0.25
_BACKGROUND_WEIGHT = 0.02


@dataclass(frozen=True)
class Patches:
    """The patches of a batch, cut from the last frame of their clips.

    Attributes:
        clip: int64 (N,), the clip each comes from.
        placement: float (N, 3), where it was cut, cells.
        images: float (N, C, H, W), their sides n times the stride.
        weight: float (N, n n), how much each cell counts; rows sum to 1.
    """

    clip: torch.Tensor
    placement: torch.Tensor
    images: torch.Tensor
    weight: torch.Tensor


def interest(pictures: torch.Tensor, mask: torch.Tensor, choose: str, stride: int) -> torch.Tensor:
    """Return how likely a patch is centred on each cell of the last frame.

    `mask`: on the object. `motion`: where the frames differ; so that a thin object which is
    still at the moment is found too, contrast has a quarter of the say. Where a rule finds nothing
    at all, every cell is alike.

    Args:
        pictures: float (B, T, C, H, W), a clip.
        mask: bool (B, T, H, W), the object.
        choose: `mask` or `motion`.
        stride: Pixels along a side of a cell.

    Returns:
        float (B, h w), rows sum to 1.
    """
    if choose == "mask":
        energy = functional.avg_pool2d(mask[:, -1:].float(), stride)
    else:
        change = pictures.diff(dim=1).abs().mean(dim=(1, 2))[:, None]
        moved = _over_noise(functional.avg_pool2d(change, stride))
        grey = pictures[:, -1].mean(dim=1, keepdim=True)
        mean = functional.avg_pool2d(grey, stride)
        square = functional.avg_pool2d(grey.square(), stride)
        contrast = _over_noise((square - mean.square()).clamp(min=0).sqrt())
        energy = (1 - _STILL_SHARE) * moved + _STILL_SHARE * contrast
    energy = energy.flatten(1)
    total = energy.sum(dim=1, keepdim=True)
    return torch.where(total > 0, energy / total.clamp(min=1e-12), 1 / energy.shape[1])


def _over_noise(energy: torch.Tensor) -> torch.Tensor:
    """Return what stands out of the median, as shares of the whole; all 0 where nothing does."""
    median = energy.flatten(1).median(dim=1).values[:, None, None, None]
    over = (energy - 2 * median).clamp(min=0)
    total = over.sum(dim=(1, 2, 3), keepdim=True)
    return over / total.clamp(min=1e-12)


def draw_patches(
    images: torch.Tensor,
    mask: torch.Tensor,
    cells: int,
    settings: ClipSettings,
    generator: torch.Generator,
    stride: int = 8,
) -> Patches:
    """Cut patches from the last frame of each clip.

    Args:
        images: float (B, T, C, H, W), the network's input.
        mask: bool (B, T, H, W), the object; only the rule `mask` looks at it.
        cells: Cells along a patch's side n.
        settings: How many, where they come from, how they are changed.
        generator: Source of randomness, on the device of the images.
        stride: Pixels along a side of a cell.

    Returns:
        The patches, N = B count.
    """
    choose, count = settings.choose, settings.patches
    clips, device = len(images), images.device
    height, width = images.shape[-2] // stride, images.shape[-1] // stride
    chances = interest(images[:, :, : settings.colours], mask, choose, stride)
    chosen = torch.multinomial(chances, count, replacement=True, generator=generator).flatten()
    centre = torch.stack([chosen % width, chosen // width], dim=1).float()
    # Off the cell's centre, and the object off the patch's: the middle must not be the answer.
    draws = torch.rand(len(chosen), 3, generator=generator, device=device)
    centre = centre + 0.5 + (draws[:, :2] - 0.5) * (cells / 2)
    half = torch.tensor([cells / 2, cells / 2], device=device)
    size = torch.tensor([float(width), float(height)], device=device)
    centre = centre.clamp(torch.minimum(half, size / 2), torch.maximum(size - half, size / 2))
    angle = (2 * draws[:, 2:] - 1) * math.radians(settings.turn_deg)
    placement = torch.cat([centre, angle], dim=1)
    clip = torch.arange(clips, device=device).repeat_interleave(count)
    last = images[:, -1][clip]
    cut = cut_patches(last, placement, cells, stride)
    if settings.recolour > 0:
        colours = settings.colours
        noise = torch.rand(len(cut), 2, colours, generator=generator, device=device) * 2 - 1
        gain, offset = (settings.recolour * noise)[..., None, None].unbind(dim=1)
        cut[:, :colours] = cut[:, :colours] * (1 + gain) + offset
    # Cells outside the frame count nothing, those next to the object little where it is known.
    xy = place(placement, cell_grid(cells, device))
    weight = ((xy >= 0) & (xy <= size)).all(dim=2).float()
    if choose == "mask":
        cover = functional.avg_pool2d(mask[:, -1:].float(), stride)[clip]
        weight = weight * (sample_descriptors(cover, xy)[..., 0] + _BACKGROUND_WEIGHT)
    return Patches(clip, placement, cut, weight / weight.sum(dim=1, keepdim=True).clamp(min=1e-12))
