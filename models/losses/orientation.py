"""Orientation loss: how the material lies at each point, as a task beside matching.

    L = mean |t'(x) - t(x)|^2 + 4 mean (s'(x) - s(x))^2

over the points seen, with t the unit vector in the image along which the first material coordinate
grows, s the sine of the angle about a rope, and t', s' the network's (Pliant's own; see
`pliant.loaders.orientation`).

On a rope, left and right of the centre line are told apart only by the way along it: a product of
two things, neither of which helps alone, so that matching by itself does not begin to learn them
and answers with the middle of the rope. Asked for both outright, a network learns them early.
"""

from __future__ import annotations

from typing import Final

import torch

_SINE_WEIGHT: Final = 4.0
"""The sine varies by 1/2 where the direction varies by 1, and is the harder of the two."""


def orientation_loss(
    predicted: torch.Tensor, target: torch.Tensor, visible: torch.Tensor
) -> torch.Tensor:
    """Return the mean squared error of directions, and four times that of sines.

    Args:
        predicted: float (N, Q, 3): direction (u, v) and sine.
        target: float (N, Q, 3); NaN where unknown.
        visible: bool (N, Q), the points that count.

    Returns:
        Scalar, from 0; 0 without points.
    """
    direction = _mean_square(predicted[..., :2], target[..., :2], visible)
    return direction + _SINE_WEIGHT * _mean_square(predicted[..., 2:], target[..., 2:], visible)


def _mean_square(
    predicted: torch.Tensor, target: torch.Tensor, visible: torch.Tensor
) -> torch.Tensor:
    counts = visible & target.isfinite().all(dim=-1)
    error = (predicted - target.nan_to_num()).square().sum(dim=-1)
    return torch.where(counts, error, 0.0).sum() / counts.sum().clamp_min(1)
