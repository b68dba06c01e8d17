"""The network of TimeCycle: encoder, affinity, localiser."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from pliant.models.networks.descriptor_network import build_network, sample_descriptors
from pliant.models.timecycle.affinity import affinity
from pliant.models.timecycle.localiser import MomentLocaliser
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
        self.encoder = build_network(settings.network, seen, learn_scale=False)
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
