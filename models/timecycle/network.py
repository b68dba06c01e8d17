"""The network of TimeCycle: encoder, affinity, localiser."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from pliant.models.networks.descriptor_network import sample_descriptors
from pliant.models.timecycle.affinity import affinity
from pliant.models.timecycle.encoder import STRIDE, build_encoder
from pliant.models.timecycle.localiser import build_localiser
from pliant.models.timecycle.placement import cell_grid, place
from pliant.models.timecycle.settings import TimeCycleSettings


class TimeCycleNetwork(nn.Module):
    """What a run trains.

    Args:
        settings: The run's settings; pretrained weights are loaded where they name some.
    """

    def __init__(self, settings: TimeCycleSettings) -> None:
        super().__init__()
        self.size = (settings.width // STRIDE, settings.height // STRIDE)
        self.cells = settings.patch_cells
        self.temperature = settings.temperature
        self.encoder = build_encoder(settings.encoder)
        self.localiser = build_localiser(self.size, self.cells, settings.localiser)

    def encode(self, images: torch.Tensor) -> torch.Tensor:
        """Map images (N, 3, H, W) to unit descriptors float32 (N, D, H / 8, W / 8)."""
        return functional.normalize(self.encoder(images).float(), dim=1)

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
