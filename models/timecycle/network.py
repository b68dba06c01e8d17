"""The network of TimeCycle: encoder, affinity, localiser."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from pliant.models.networks.descriptor_network import DescriptorNetwork, sample_descriptors
from pliant.models.timecycle.affinity import affinity
from pliant.models.timecycle.placement import cell_grid, place
from pliant.models.timecycle.settings import TimeCycleSettings


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
