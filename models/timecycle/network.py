"""The network of TimeCycle: encoder, affinity, localiser, and where a patch is in a frame.

Positions are in cells, with the centre of the top-left cell at (0.5, 0.5): Pliant's pixel
convention, divided by the stride. A placement is (x, y, angle); a positive angle turns u
towards v (clockwise on the screen). The scale is fixed: a cell stays a cell.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from pliant.models.networks.descriptor_network import DescriptorNetwork, sample_descriptors
from pliant.models.timecycle.settings import TimeCycleSettings


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


class TimeCycleNetwork(nn.Module):
    """What a run trains.

    Args:
        settings: The run's settings; pretrained weights are loaded where they name some.
    """

    def __init__(self, settings: TimeCycleSettings) -> None:
        super().__init__()
        self.stride, self.lift = settings.stride, settings.lift
        self.size = (settings.width // self.stride, settings.height // self.stride)
        self.cells = settings.patch_cells
        self.temperature = settings.temperature
        seen = settings.clips.network_input
        self.encoder = DescriptorNetwork(settings.network, seen, learn_scale=False)
        self.localiser = MomentLocaliser(self.size, self.cells)

    def encode(self, images: torch.Tensor, stride: int | None = None) -> torch.Tensor:
        """Return unit descriptors of the cells of images.

        Args:
            images: float (N, C, H, W).
            stride: Pixels along a side of a cell; None for the training's.

        Returns:
            float32 (N, D, H / stride, W / stride), with one channel more where there is a lift.
        """
        described = functional.avg_pool2d(self.encoder(images).float(), stride or self.stride)
        if self.lift > 0:
            described = described * self.encoder.scale.sqrt()
            described = functional.pad(described, (0, 0, 0, 0, 0, 1), value=self.lift)
        return functional.normalize(described, dim=1)

    def locate(
        self, patch: torch.Tensor, frame: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Find a patch in a frame.

        Args:
            patch: float (B, n n, D), unit descriptors of the patch's cells.
            frame: float (B, D, h, w), unit descriptors of the frame.

        Returns:
            Placements (B, 3); what is there, unit descriptors (B, n n, D); the affinities
            (B, n n, h w).
        """
        affinities = affinity(patch, frame, self.temperature)
        placement = self.localiser(affinities)
        grid = cell_grid(self.cells, patch.device)
        found = functional.normalize(sample_descriptors(frame, place(placement, grid)), dim=2)
        return placement, found, affinities


_TINY = 1e-6


class MomentLocaliser(nn.Module):
    """The rigid motion that best fits where each cell of the patch is expected.

    The affine map of the paper has three free parameters, (dx, dy, angle), and a fixed scale: here
    the placement's centre and angle in cells.

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
