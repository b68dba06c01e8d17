"""Orientation loss: how the material is oriented, as a task in addition to matching.

    L = mean |t'(x) - t(x)|^2 + 4 mean (s'(x) - s(x))^2

over the points seen, with t the unit vector in the image along which the first material coordinate
grows, s the sine of the angle about a rope, and t', s' the network's (Pliant's own; see
`pliant.loaders.orientation`).

On a rope, left and right of the centre line differ only by the direction along it: a product of
two things, neither of which helps alone, so that matching by itself does not begin to learn them
and answers with the middle of the rope. Asked for both outright, a network learns them early.
"""

from __future__ import annotations

from typing import Final

import torch

_SINE_WEIGHT: Final = 4.0
"""The sine varies by 1/2 where the direction varies by 1, and is the harder of the two."""


def orientation_loss(
    predicted: torch.Tensor,
    target: torch.Tensor,
    visible: torch.Tensor,
    *,
    reversible: bool = False,
) -> torch.Tensor:
    """Return the mean squared error of directions, and four times that of sines.

    Args:
        predicted: float (N, Q, 3): direction (u, v) and sine.
        target: float (N, Q, 3); NaN where unknown.
        visible: bool (N, Q), the points that count.
        reversible: The material looks the same with both coordinates reversed (a rope without
            its ball): each image may be answered with all signs changed, but only all at once.

    Returns:
        Scalar, from 0; 0 without points.
    """
    way = visible & target[..., :2].isfinite().all(dim=-1)
    side = visible & target[..., 2].isfinite()
    weight = torch.stack([way, way, side], dim=-1) / torch.stack(
        [way.sum(), way.sum(), side.sum() / _SINE_WEIGHT]
    ).clamp_min(1 / _SINE_WEIGHT)
    known = target.nan_to_num()
    signs = (1.0, -1.0) if reversible else (1.0,)
    costs = [((predicted - sign * known).square() * weight).sum(dim=(1, 2)) for sign in signs]
    return torch.stack(costs).amin(dim=0).sum()
