"""Where the matches of queries are, and what competes with them: pixels of the target image."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch.nn import functional

from pliant.models.networks.descriptor_network import pixel_grid


@dataclass(frozen=True)
class Candidates:
    """M competing pixels (or bins) in each of N images.

    Attributes:
        descriptors: float (N, M, D).
        uv_px: float (N, M, 2), their centres in the network's pixels.
        on_object: bool (N, M), where the target distribution may have mass.
    """

    descriptors: torch.Tensor
    uv_px: torch.Tensor
    on_object: torch.Tensor


@dataclass(frozen=True)
class Targets:
    """The true positions of Q queries in each of N images.

    Attributes:
        uv_px: float (N, Q, R, 2), the match and its symmetry partners, R >= 1.
        valid: bool (N, Q, R), which of them exist and are visible.
    """

    uv_px: torch.Tensor
    valid: torch.Tensor


@dataclass(frozen=True)
class NonMatches:
    """K places per query that are not its match.

    Attributes:
        descriptors: float (N, Q, K, D).
        uv_px: float (N, Q, K, 2), where they are.
    """

    descriptors: torch.Tensor
    uv_px: torch.Tensor


def all_bins(descriptors: torch.Tensor, mask: torch.Tensor, bin_px: int = 1) -> Candidates:
    """Let every bin of the image compete.

    Args:
        descriptors: float (N, D, h, w).
        mask: bool (N, h, w).
        bin_px: Side of a bin; its descriptor is the mean of its pixels', and it is on the
            object if any of them does. Pixels beyond the last whole bin are left out.
    """
    if bin_px > 1:
        descriptors = functional.avg_pool2d(descriptors, bin_px)
        mask = functional.max_pool2d(mask.float()[:, None], bin_px)[:, 0] > 0
    n, _, height, width = descriptors.shape
    uv = pixel_grid(height, width, bin_px, descriptors.device)[None].expand(n, -1, -1)
    return Candidates(descriptors.flatten(2).transpose(1, 2), uv, mask.flatten(1))


def object_and_background(
    descriptors: torch.Tensor,
    mask: torch.Tensor,
    background: int,
    generator: torch.Generator | None = None,
) -> Candidates:
    """Let every pixel on the object compete, and some drawn from the rest.

    Most of a rope's image is table: with all of its pixels the loss costs more than the
    network, and nearly all of them are easy.

    Args:
        descriptors: float (N, D, h, w).
        mask: bool (N, h, w).
        background: Background pixels, at least (an image with a smaller object gets more).
        generator: Source of randomness, on the mask's device.
    """
    _, _, height, width = descriptors.shape
    flat = mask.flatten(1)
    count = min(int(flat.sum(dim=1).max()) + background, height * width)
    draw = torch.rand(flat.shape, generator=generator, device=flat.device)
    # Object pixels have priority 2, the others a random one below 1.
    order = torch.where(flat, 2.0, draw).topk(max(count, 1), dim=1, sorted=False)
    chosen = order.indices  # (N, M)
    grid = pixel_grid(height, width, 1, descriptors.device)
    at = chosen[:, None].expand(-1, descriptors.shape[1], -1)  # (N, D, M)
    picked = descriptors.flatten(2).gather(2, at).transpose(1, 2).contiguous()
    return Candidates(picked, grid[chosen], flat.gather(1, chosen))


def widened(mask: torch.Tensor, by_px: int) -> torch.Tensor:
    """Return a mask grown by some pixels in each direction.

    At the network's size the mask is where the object covers half a pixel: of the points seen at
    a thin rope's sides, one in eight is outside it.

    Args:
        mask: bool (N, h, w).
        by_px: 0 for the mask itself.
    """
    if by_px == 0:
        return mask
    kernel = 2 * by_px + 1
    return functional.max_pool2d(mask.float()[:, None], kernel, 1, by_px)[:, 0] > 0
