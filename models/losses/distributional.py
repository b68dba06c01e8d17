"""The distributional loss: descriptors define where a point is, as a probability over pixels.

With a query's descriptor f and the descriptors g_y of the candidate pixels y of the target,

    p(y) = softmax_y( -scale * ||f - g_y||^2 ),

where `scale` is an inverse temperature, learned or set (descriptors of unit length need one:
without it no peak over 19,200 pixels passes 2e-4). The target is a Gaussian around the true
position, or around every visible member of its symmetry orbit, on the object's pixels alone:

    q(y)  proportional to  1[y on object] * sum_r exp(-|y - x_r|^2 / (2 sigma^2)),   sum q = 1.

Two directions of the Kullback-Leibler divergence:

* `forward`, KL(q || p) = sum q (log q - log p): mass-covering. Each true mode must get its
  share; this is cross-entropy less the entropy of q.
* `reverse`, KL(p || q) = sum p (log p - log q): mode-seeking. One of the modes is enough,
  so symmetric targets are barely enforced; log q is floored, since q is 0 off the object.
"""

from __future__ import annotations

from typing import Final, Literal

import torch
from torch.utils.checkpoint import checkpoint

Direction = Literal["forward", "reverse"]

LOG_FLOOR: Final = -20.0
"""Smallest log q in the reverse direction; what a pixel without any target mass costs."""

_NEVER: Final = -1e30


@torch.no_grad()
def gaussian_log_target(
    candidate_uv_px: torch.Tensor,
    on_object: torch.Tensor,
    target_uv_px: torch.Tensor,
    target_valid: torch.Tensor,
    sigma_px: float,
) -> torch.Tensor:
    """Return log q over the candidates (it has no gradient).

    Args:
        candidate_uv_px: float (N, M, 2), pixel centres.
        on_object: bool (N, M), where q may have mass.
        target_uv_px: float (N, Q, R, 2), the true position and its symmetry partners.
        target_valid: bool (N, Q, R), which of them exist and are visible.
        sigma_px: Width of each Gaussian, px.

    Returns:
        float (N, Q, M); exp sums to 1 where a target exists; about -1e30 off the object. Each
        mode has the same mass.
    """
    # The object's mask as a bias: 0 on it, -1e30 off it. Dense passes over (N, Q, M) are what
    # this costs, so they are few and in place.
    bias = torch.zeros_like(candidate_uv_px[..., 0]).masked_fill_(~on_object, _NEVER)[:, None]
    R = target_uv_px.shape[2]
    mixture: torch.Tensor | None = None
    for r in range(R):
        mode = target_uv_px[:, :, r, 0, None] - candidate_uv_px[:, None, :, 0]  # (N, Q, M)
        mode.square_()
        gap = target_uv_px[:, :, r, 1, None] - candidate_uv_px[:, None, :, 1]
        mode.addcmul_(gap, gap).mul_(-0.5 / sigma_px**2).add_(bias)
        mode.sub_(mode.logsumexp(dim=-1, keepdim=True))
        if R > 1:
            mode.masked_fill_(~target_valid[:, :, r, None], _NEVER)
        mixture = mode if mixture is None else torch.logaddexp(mixture, mode)
    if mixture is None:
        raise ValueError("a target needs at least one position")
    if R > 1:
        mixture.sub_(target_valid.sum(dim=-1, keepdim=True).clamp_min(1).log())
    return mixture.add_(bias).clamp_min_(_NEVER)


def log_probabilities(
    query: torch.Tensor,
    candidates: torch.Tensor,
    candidate_valid: torch.Tensor,
    scale: torch.Tensor,
) -> torch.Tensor:
    """Return log p over the candidates.

    Args:
        query: float (N, Q, D).
        candidates: float (N, M, D).
        candidate_valid: bool (N, M), False for padding.
        scale: Scalar, inverse temperature.

    Returns:
        float (N, Q, M).
    """
    # ||f||^2 is the same for every candidate and drops out of the softmax.
    dot = query @ candidates.transpose(1, 2)
    bias = -scale * (candidates**2).sum(dim=-1)
    bias = bias.masked_fill(~candidate_valid, _NEVER)[:, None]
    return torch.addcmul(bias, dot, 2 * scale).log_softmax(dim=-1)


def distributional_loss(
    query: torch.Tensor,
    candidates: torch.Tensor,
    candidate_uv_px: torch.Tensor,
    candidate_valid: torch.Tensor,
    on_object: torch.Tensor,
    target_uv_px: torch.Tensor,
    target_valid: torch.Tensor,
    *,
    scale: torch.Tensor,
    sigma_px: float,
    direction: Direction = "forward",
    chunk: int | None = None,
) -> torch.Tensor:
    """Return the mean divergence between p and q over the queries that have a target.

    Args:
        query: float (N, Q, D), descriptors of the queries.
        candidates: float (N, M, D), descriptors of the target's candidate pixels.
        candidate_uv_px: float (N, M, 2), their centres.
        candidate_valid: bool (N, M), False for padding.
        on_object: bool (N, M), where the target distribution may have mass.
        target_uv_px: float (N, Q, R, 2).
        target_valid: bool (N, Q, R).
        scale: Scalar, inverse temperature.
        sigma_px: Width of the target's Gaussians, px.
        direction: `forward` KL(q || p) or `reverse` KL(p || q).
        chunk: Queries at a time, recomputed in the backward pass, so that memory holds
            N x chunk x M values; None for all at once.

    Returns:
        A scalar; 0 if no query has a target.
    """
    on_object = on_object & candidate_valid

    def divergence(
        query: torch.Tensor, target_uv: torch.Tensor, target_valid: torch.Tensor
    ) -> torch.Tensor:
        log_p = log_probabilities(query, candidates, candidate_valid, scale)
        log_q = gaussian_log_target(candidate_uv_px, on_object, target_uv, target_valid, sigma_px)
        if direction == "forward":
            # Where q is 0, log q is -1e30 and 0 * -1e30 is 0: no product needs a mask.
            q = log_q.exp()
            each = torch.mul(q, log_q) - q * log_p
        else:
            # p is 0 on padding, and 0 * (finite) is 0: the product needs no mask.
            each = log_p.exp() * (log_p - log_q.clamp_min(LOG_FLOOR)).masked_fill(
                ~candidate_valid[:, None], 0.0
            )
        has_target = target_valid.any(dim=-1) & on_object.any(dim=-1, keepdim=True)
        return (each.sum(dim=-1) * has_target).sum()

    size = chunk or query.shape[1]
    total = query.new_zeros(())
    for start in range(0, query.shape[1], size):
        piece = (
            query[:, start : start + size],
            target_uv_px[:, start : start + size],
            target_valid[:, start : start + size],
        )
        if chunk is None:
            total = total + divergence(*piece)
        else:
            total = total + checkpoint(divergence, *piece, use_reentrant=False)
    number = (target_valid.any(dim=-1) & on_object.any(dim=-1, keepdim=True)).sum()
    return total / number.clamp_min(1)
