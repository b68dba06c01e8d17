"""Affinities between the cells of a patch and those of a frame."""

from __future__ import annotations

import torch


def affinity(patch: torch.Tensor, frame: torch.Tensor, temperature: float) -> torch.Tensor:
    """Return the softmax of descriptor products over a frame's cells.

    Args:
        patch: float (B, P, D), unit descriptors of a patch's cells.
        frame: float (B, D, h, w), unit descriptors of a frame.
        temperature: Divides the products.

    Returns:
        float (B, P, h w); rows sum to 1.
    """
    return (torch.bmm(patch, frame.flatten(2)) / temperature).softmax(dim=2)


def soft_inlier(
    affinities: torch.Tensor, xy: torch.Tensor, width: int, spread: float
) -> torch.Tensor:
    """Return how much of each cell's affinity is where the cell belongs.

    The soft inlier count of Rocco et al. (2018): the mass within a Gaussian window about the
    place that a transformation gives the cell, the window 1 at its centre.

    Args:
        affinities: float (B, P, M), rows sum to 1, M = h w.
        xy: float (B, P, 2), where each cell belongs, in cells of the frame.
        width: Columns of the frame w.
        spread: Standard deviation of the window, cells.

    Returns:
        float (B, P), 0 to 1.
    """
    cells = affinities.shape[2]
    height = cells // width
    device = affinities.device
    u = torch.arange(width, device=device) + 0.5
    v = torch.arange(height, device=device) + 0.5
    # The Gaussian is a product of one in u and one in v: two small tables instead of one large.
    along_u = torch.exp(-((xy[..., :1] - u) ** 2) / (2 * spread**2))  # (B, P, w)
    along_v = torch.exp(-((xy[..., 1:] - v) ** 2) / (2 * spread**2))  # (B, P, h)
    rows = (affinities.unflatten(2, (height, width)) * along_u[:, :, None]).sum(dim=3)
    return (rows * along_v).sum(dim=2)
