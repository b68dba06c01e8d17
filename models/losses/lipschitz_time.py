"""A Lipschitz condition in time: a small action moves a point by no more than a little.

With x_b a pixel of a frame, x̂_a the position predicted for it in the next frame of the
episode, and d_action the size of the action between them (in pixels),

    L = mean over queries  max(0, mu ( ||x̂_a - x_b|| - lipschitz * d_action )).
"""

from __future__ import annotations

import torch

_TINY = 1e-12


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
