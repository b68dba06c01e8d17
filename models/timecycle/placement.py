"""Where a patch is in a frame: centre and angle, its cells, and what is under them.

Positions are in cells, with the centre of the top-left cell at (0.5, 0.5): Pliant's pixel
convention, divided by the stride. A placement is (x, y, angle); a positive angle turns u
towards v (clockwise on the screen). The scale is fixed: a cell stays a cell.
"""

from __future__ import annotations

import torch

from pliant.models.networks.descriptor_network import sample_descriptors


def cell_grid(cells: int, device: torch.device, points: int | None = None) -> torch.Tensor:
    """Return positions in a patch relative to its centre, row by row.

    Args:
        cells: Cells along its side n.
        device: Where to make it.
        points: Positions along a side, spread over the patch; None for the cells' centres.

    Returns:
        float32 (points^2, 2), cells.
    """
    count = points or cells
    line = (torch.arange(count, device=device) + 0.5) * (cells / count) - cells / 2
    v, u = torch.meshgrid(line, line, indexing="ij")
    return torch.stack([u, v], dim=-1).reshape(-1, 2)


def place(placement: torch.Tensor, grid: torch.Tensor) -> torch.Tensor:
    """Return where a patch's positions are in the frame.

    Args:
        placement: float (B, 3), centre and angle.
        grid: float (P, 2), positions relative to the centre.

    Returns:
        float (B, P, 2), cells of the frame.
    """
    cos, sin = placement[:, 2].cos(), placement[:, 2].sin()
    turn = torch.stack([torch.stack([cos, sin], -1), torch.stack([-sin, cos], -1)], dim=1)
    return grid @ turn + placement[:, None, :2]


def cut_patches(
    images: torch.Tensor, placement: torch.Tensor, cells: int, stride: int = 8
) -> torch.Tensor:
    """Return square patches of images, upright in their own frame.

    Args:
        images: float (B, C, H, W).
        placement: float (B, 3), in cells.
        cells: Cells along a patch's side n.
        stride: Pixels along a side of a cell.

    Returns:
        float (B, C, stride n, stride n).
    """
    side = stride * cells
    pixels = place(placement, cell_grid(cells, images.device, points=side)) * stride
    return sample_descriptors(images, pixels).transpose(1, 2).unflatten(2, (side, side))
