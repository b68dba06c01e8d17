"""Stretch loss: the canonical head's map must stretch the material as it is stretched.

    L = mean over near pairs of  sqrt(1 + |dm' - dm|^2 / (|dm|^2 + r^2 / 100)) - 1,

dm the step on the material between two points seen in one image, dm' the step between the material
coordinates that the head expects at their pixels, r the reach of a pair: a finite difference of
the map's Jacobian, in proportion (Pliant's own). The cross-entropy asks where a pixel is; this
asks that neighbours stay neighbours, and that they have their distance.
"""

from __future__ import annotations

from typing import Final

import torch

from pliant.models.networks.canonical import CanonicalHead

_FLOOR: Final = 0.01  # of the squared reach, so that the nearest pairs do not decide


def stretch_loss(
    head: CanonicalHead,
    descriptors: torch.Tensor,
    material: torch.Tensor,
    visible: torch.Tensor,
    *,
    scale: torch.Tensor,
    reach_m: float,
) -> torch.Tensor:
    """Return the mean error of steps between near points, in proportion to the steps.

    Coordinates with a period (a rope's angle) have no mean and are left out.

    Args:
        head: The canonical head.
        descriptors: float (N, Q, D), at the points.
        material: float (N, Q, 2), their material coordinates.
        visible: bool (N, Q), the points that count.
        scale: Scalar, inverse temperature.
        reach_m: Pairs of points farther apart on the material do not count, metres.

    Returns:
        Scalar, from 0; 0 without a pair.
    """
    metres = head.scale_m * (head.period == 0)  # (2,)
    p = head.log_probabilities(descriptors.flatten(0, 1), scale).exp()
    expected = (p @ (head.anchors * metres)).view(*visible.shape, 2)
    exact = material * metres
    step = exact[:, :, None] - exact[:, None]  # (N, Q, Q, 2)
    off = expected[:, :, None] - expected[:, None] - step
    squared = step.square().sum(dim=-1)
    near = (visible[:, :, None] & visible[:, None] & (squared <= reach_m**2)).triu(1)
    ratio = off.square().sum(dim=-1) / (squared + _FLOOR * reach_m**2)
    return (((1 + ratio).sqrt() - 1) * near).sum() / near.sum().clamp_min(1)
