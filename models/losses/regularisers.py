"""Terms in addition to matching: Lipschitz conditions, the stretch of the map, orientation.

*Lipschitz conditions.* In space, neighbouring pixels must not map far apart. With x_b some pixels
and x̂_a the positions predicted for them (soft-argmax),

    L = mean over pairs (i, j)  max(0, mu ( ||x̂_a,i - x̂_a,j|| - lipschitz ||x_b,i - x_b,j|| )).

The pixels are those of material points that are near each other on the material: a disc of the
image may show two strands, between which the truth itself violates the condition.
The penalty weight mu grows on a schedule, as in a penalty method.

In time, a small action moves a point by no more than a little. With x_b a pixel of a frame, x̂_a
the position predicted for it in the next frame of the episode, and d_action the size of the action
between them (in pixels),

    L = mean over queries  max(0, mu ( ||x̂_a - x_b|| - lipschitz * d_action )).

*Stretch.* The canonical head's map must stretch the material as it is stretched.

    L = mean over near pairs of  sqrt(1 + |dm' - dm|^2 / (|dm|^2 + r^2 / 100)) - 1,

dm the step on the material between two points seen in one image, dm' the step between the material
coordinates that the head expects at their pixels, r the reach of a pair: a finite difference of
the map's Jacobian, in proportion (Pliant's own). The cross-entropy asks where a pixel is; this
asks that neighbours stay neighbours, and that they have their distance.

*Orientation.* How the material is oriented, as a task in addition to matching.

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

from pliant.models.networks.canonical import CanonicalHead

_TINY = 1e-12


def soft_argmax(log_p: torch.Tensor, candidate_uv_px: torch.Tensor) -> torch.Tensor:
    """Return the mean position under p, which has a gradient (an argmax has none).

    Args:
        log_p: float (N, Q, M), log probabilities over the candidates.
        candidate_uv_px: float (N, M, 2), their positions, in the same order.

    Returns:
        float (N, Q, 2).
    """
    return log_p.exp() @ candidate_uv_px


def lipschitz_space_loss(
    predicted_uv_px: torch.Tensor,
    pixel_uv_px: torch.Tensor,
    valid: torch.Tensor,
    near: torch.Tensor,
    *,
    lipschitz: float,
    mu: float,
) -> torch.Tensor:
    """Return the mean violation over the pairs of pixels of each image.

    Args:
        predicted_uv_px: float (N, P, 2), where the pixels are predicted to be.
        pixel_uv_px: float (N, P, 2), the pixels themselves.
        valid: bool (N, P).
        near: bool (N, P, P), symmetric: the pairs that count.
        lipschitz: The constant, > 0: how far neighbours may be stretched.
        mu: Penalty weight, >= 0.

    Returns:
        A scalar; 0 if no image has a pair of valid pixels.
    """
    first, second = torch.triu_indices(
        pixel_uv_px.shape[1], pixel_uv_px.shape[1], offset=1, device=pixel_uv_px.device
    )
    moved = predicted_uv_px[:, first] - predicted_uv_px[:, second]  # (N, pairs, 2)
    apart = (pixel_uv_px[:, first] - pixel_uv_px[:, second]).norm(dim=-1)
    stretched = ((moved**2).sum(dim=-1) + _TINY).sqrt()
    both = valid[:, first] & valid[:, second] & near[:, first, second]
    violation = (mu * (stretched - lipschitz * apart)).clamp_min(0)
    return (violation * both).sum() / both.sum().clamp_min(1)


def penalty_weight(progress: float, start: float, end: float) -> float:
    """Return mu, growing geometrically from `start` to `end` as progress goes from 0 to 1.

    Args:
        progress: Share of the training done, 0 to 1.
        start: First value, > 0.
        end: Last value, >= start.
    """
    return float(start * (end / start) ** min(max(progress, 0.0), 1.0))


def lipschitz_time_loss(
    predicted_uv_px: torch.Tensor,
    pixel_uv_px: torch.Tensor,
    action_px: torch.Tensor,
    valid: torch.Tensor,
    *,
    lipschitz: float,
    mu: float,
) -> torch.Tensor:
    """Return the mean violation over the queries of pairs that an action connects.

    Args:
        predicted_uv_px: float (N, Q, 2), positions in the other frame.
        pixel_uv_px: float (N, Q, 2), the query pixels.
        action_px: float (N,), d_action in pixels; +inf where no action connects the frames.
        valid: bool (N, Q).
        lipschitz: The constant, > 0.
        mu: Penalty weight, >= 0.

    Returns:
        A scalar; 0 if no pair is connected.
    """
    connected = valid & torch.isfinite(action_px)[:, None]
    bound = lipschitz * torch.where(torch.isfinite(action_px), action_px, 0.0)
    moved = (((predicted_uv_px - pixel_uv_px) ** 2).sum(dim=-1) + _TINY).sqrt()  # (N, Q)
    violation = (mu * (moved - bound[:, None])).clamp_min(0)
    return (violation * connected).sum() / connected.sum().clamp_min(1)


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
