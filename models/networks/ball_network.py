"""Whether a rope's ball is near a place, and where, from a patch of the image and of the mask."""

from __future__ import annotations

from typing import Final

import numpy as np
import torch
from torch import nn

from pliant.models.networks.patches import judging_layers, normalised, patches
from pliant.spec.arrays import Float32Array, FloatArray, Mask

BALL: Final = "ball.safetensors"
"""The weights of a run's `BallNetwork`."""

REACH: Final = 8.0
"""Half the side of a patch, in half widths of the rope."""

_USUAL_RADIUS: Final = 3.0  # of a ball, in half widths of the rope


def ball_patches(
    picture: Float32Array,
    objects: Mask,
    place_px: FloatArray,
    directions: FloatArray,
    half_px: float,
) -> torch.Tensor:
    """Sample the surroundings of places where a ball may be.

    Args:
        picture: float32 (H, W, 3), colours from 0 to 1.
        objects: bool (H, W), where the rope or its ball is seen.
        place_px: float64 (N, 2).
        directions: float64 (N, 2), unit vectors out of the rope.
        half_px: Half the rope's width.

    Returns:
        float32 (N, 4, PATCH, PATCH): colours, and 1 where the mask is set.
    """
    planes = np.concatenate([picture, objects[..., None].astype(np.float32)], axis=2)
    return patches(planes, place_px, directions, np.full(len(place_px), REACH * half_px))


class BallNetwork(nn.Module):
    """Log odds that a ball is at the middle of patches, or just outside of the rope's end there."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = judging_layers(3 + 1, 1 + 3)

    def forward(self, seen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Look at patches by `ball_patches`.

        Returns:
            Log odds, float (N,), and the ball if there is one, float (N, 3): how far its middle is
            ahead and aside of the patch's, and its radius, in half widths of the rope.
        """
        out: torch.Tensor = self.layers(torch.cat([normalised(seen[:, :3]), seen[:, 3:]], dim=1))
        return out[:, 0], torch.cat([out[:, 1:3], _USUAL_RADIUS * out[:, 3:].exp()], dim=1)
