"""The localiser: from affinities to a placement of the patch in the frame.

The affine map of the paper has three free parameters, (dx, dy, angle), and a fixed scale: here
the placement's centre and angle in cells.
"""

from __future__ import annotations

import torch
from torch import nn

from pliant.models.timecycle.placement import cell_grid

_TINY = 1e-6


class MomentLocaliser(nn.Module):
    """The rigid motion that best fits where each cell of the patch is expected.

    Each cell's expected place is the mean of its affinity; cells count by how sure they are
    (the sum of their squared affinities, without gradient: a network must not win by choosing
    which cells to listen to). Centre and angle of the weighted least squares fit have a closed
    form (Procrustes in the plane), so nothing has to be learned first.

    Args:
        size: (w, h) of a frame, cells.
        cells: Cells along a patch's side.
    """

    def __init__(self, size: tuple[int, int], cells: int) -> None:
        super().__init__()
        self.size, self.cells = size, cells

    def forward(self, affinities: torch.Tensor) -> torch.Tensor:
        """Map affinities (B, n n, w h) to placements (B, 3)."""
        width, height = self.size
        device = affinities.device
        grids = affinities.unflatten(2, (height, width))
        u = torch.arange(width, device=device) + 0.5
        v = torch.arange(height, device=device) + 0.5
        expected = torch.stack([grids.sum(dim=2) @ u, grids.sum(dim=3) @ v], dim=-1)  # (B, P, 2)
        weight = affinities.detach().square().sum(dim=2)
        weight = weight / weight.sum(dim=1, keepdim=True)
        own = cell_grid(self.cells, device)
        middle = weight @ own  # (B, 2), of the cells that count
        found = (weight[..., None] * expected).sum(dim=1)
        a = own[None] - middle[:, None]
        b = expected - found[:, None]
        along = (weight * (a * b).sum(dim=-1)).sum(dim=1)
        across = (weight * (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])).sum(dim=1)
        angle = torch.atan2(across, along + _TINY)
        cos, sin = angle.cos(), angle.sin()
        turned = torch.stack(
            [cos * middle[:, 0] - sin * middle[:, 1], sin * middle[:, 0] + cos * middle[:, 1]], -1
        )
        return torch.cat([found - turned, angle[:, None]], dim=1)
