"""Lipschitz conditions in space and in time.

In space, neighbouring pixels must not map far apart. With x_b some pixels and x̂_a the positions
predicted for them (soft-argmax),

    L = mean over pairs (i, j)  max(0, mu ( ||x̂_a,i - x̂_a,j|| - lipschitz ||x_b,i - x_b,j|| )).

The pixels are those of material points that are near each other on the material: a disc of the
image may show two strands, between which the truth itself violates the condition.
The penalty weight mu grows on a schedule, as in a penalty method.

In time, a small action moves a point by no more than a little. With x_b a pixel of a frame, x̂_a
the position predicted for it in the next frame of the episode, and d_action the size of the action
between them (in pixels),

    L = mean over queries  max(0, mu ( ||x̂_a - x_b|| - lipschitz * d_action )).
"""

from __future__ import annotations

import torch

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
