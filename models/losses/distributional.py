"""The distributional loss: descriptors define where a point is, as a probability over pixels.

With a query's descriptor f and the descriptors g_y of the candidate pixels y of the target,

    p(y) = softmax_y( -scale * ||f - g_y||^2 ),

where `scale` is an inverse temperature, learned or set (descriptors of unit length need one:
without it no peak over 640x480 pixels passes 2e-4). The target is a Gaussian around the true
position, or around every visible member of its symmetry orbit, on the object's pixels alone,
each of the R modes with the same mass:

    q(y) = mean_r softmax_y( -|y - x_r|^2 / (2 sigma^2) ),  y on the object.

Two directions of the Kullback-Leibler divergence:

* `forward`, KL(q || p) = sum q (log q - log p): mass-covering. Each true mode must get its
  share; this is cross-entropy less the entropy of q.
* `reverse`, KL(p || q) = sum p (log p - log q): mode-seeking. One of the modes is enough,
  so symmetric targets are barely enforced; log q is floored, since q is 0 off the object.

Both have a short gradient with respect to the logits z, of which p is the softmax:

    d KL(q || p) / dz = p - q,        d KL(p || q) / dz = p (t - sum p t),  t = log p - log q.

So one pass over the candidates gives loss and gradient, piece by piece, and nothing of the size
queries x candidates is ever kept: on a CPU a piece fits its cache, which is most of the speed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final, Literal

import torch

from pliant.models.losses.matches import Candidates, Targets

Direction = Literal["forward", "reverse"]

LOG_FLOOR: Final = -20.0
"""Smallest log q in the reverse direction; what a pixel without any target mass costs."""

_NEVER: Final = -1e30
_TINY: Final = 1e-30
_CACHED: Final = 1 << 18
"""Values of a piece on a CPU: a megabyte in float32, what its second cache holds."""


@torch.no_grad()
def gaussian_target(
    candidate_uv_px: torch.Tensor,
    on_object: torch.Tensor,
    target_uv_px: torch.Tensor,
    target_valid: torch.Tensor,
    sigma_px: float,
) -> torch.Tensor:
    """Return q over the candidates (it has no gradient).

    Args:
        candidate_uv_px: float (N, M, 2), pixel centres.
        on_object: bool (N, M), where q may have mass.
        target_uv_px: float (N, Q, R, 2), the true position and its symmetry partners, R >= 1.
        target_valid: bool (N, Q, R), which of them exist and are visible.
        sigma_px: Width of each Gaussian, px.

    Returns:
        float (N, Q, M); sums to 1 where a target and an object exist, and is 0 off the object.
        Each mode has the same mass.
    """
    y_u, y_v = candidate_uv_px[:, None].unbind(dim=-1)  # (N, 1, M)
    x_u, x_v = target_uv_px[..., None, :].unbind(dim=-1)  # (N, Q, R, 1)
    steepness = -0.5 / sigma_px**2
    # The object's mask as a bias: 0 on it, -1e30 off it.
    bias = torch.zeros_like(y_u).masked_fill_(~on_object[:, None], _NEVER)
    R = target_uv_px.shape[2]
    share = target_valid / target_valid.sum(dim=-1, keepdim=True).clamp_min(1)  # (N, Q, R)
    q: torch.Tensor | None = None
    for r in range(R):
        gap = y_u - x_u[:, :, r]  # (N, Q, M)
        exponent = torch.addcmul(bias, gap, gap, value=steepness)
        torch.sub(y_v, x_v[:, :, r], out=gap)
        mode = exponent.addcmul_(gap, gap, value=steepness).softmax(dim=-1)
        if R == 1:
            return mode
        weight = share[:, :, r, None].to(mode.dtype)
        q = mode.mul_(weight) if q is None else q.addcmul_(mode, weight)
    assert q is not None  # a target has at least one position
    return q


def log_probabilities(
    query: torch.Tensor,
    candidates: torch.Tensor,
    scale: torch.Tensor,
    usable: torch.Tensor | None = None,
) -> torch.Tensor:
    """Return log p over the candidates.

    Args:
        query: float (N, Q, D).
        candidates: float (N, M, D).
        scale: Scalar, inverse temperature.
        usable: bool (N, M), the candidates that compete; None for all.

    Returns:
        float (N, Q, M).
    """
    dot = query @ candidates.transpose(1, 2)
    bias = _logit_bias(candidates, scale)
    if usable is not None:
        bias = bias.masked_fill(~usable, _NEVER)
    return torch.addcmul(bias[:, None], dot, 2 * scale).log_softmax(dim=-1)


def _logit_bias(candidates: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
    """Return what a candidate's logit has in addition to 2 scale f g: float (N, M).

    ||f||^2 is the same for every candidate and drops out of the softmax.
    """
    return -scale * (candidates**2).sum(dim=-1)


def distributional_loss(
    query: torch.Tensor,
    candidates: Candidates,
    targets: Targets,
    *,
    scale: torch.Tensor,
    sigma_px: float,
    direction: Direction = "forward",
    chunk: int | None = None,
) -> torch.Tensor:
    """Return the mean divergence between p and q over the queries that have a target.

    Args:
        query: float (N, Q, D), descriptors of the queries.
        candidates: The target's competing pixels.
        targets: The true positions.
        scale: Scalar, inverse temperature.
        sigma_px: Width of the target's Gaussians, px.
        direction: `forward` KL(q || p) or `reverse` KL(p || q).
        chunk: Queries at a time; memory holds a few times N x chunk x M values (on a CPU of
            one image: chunk x M). None for what fits the cache on a CPU, else for all at once.

    Returns:
        A scalar; 0 if no query has a target. It can be differentiated once, by the
        descriptors and the scale.
    """
    on_object = candidates.on_object
    has_target = targets.valid.any(dim=-1) & on_object.any(dim=-1, keepdim=True)  # (N, Q)
    total: torch.Tensor = _SummedDivergence.apply(
        query * (2 * scale),
        candidates.descriptors,
        _logit_bias(candidates.descriptors, scale),
        (candidates.uv_px, on_object, targets.uv_px, targets.valid, sigma_px),
        has_target,
        direction,
        chunk,
    )
    return total / has_target.sum().clamp_min(1)


class _SummedDivergence(torch.autograd.Function):
    """Sum of the divergences of all queries that count; logits are query @ candidates + bias."""

    @staticmethod
    def forward(
        ctx: Any,
        query: torch.Tensor,
        candidates: torch.Tensor,
        bias: torch.Tensor,
        target: tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, float],
        counts: torch.Tensor,
        direction: Direction,
        chunk: int | None,
    ) -> torch.Tensor:
        uv_px, on_object, target_uv_px, target_valid, sigma_px = target
        to_query = torch.empty_like(query)
        to_candidates = torch.zeros_like(candidates)
        to_bias = torch.zeros_like(bias)
        total = query.new_zeros(())
        for n, part in _pieces(len(query), query.shape[1], bias.shape[1], chunk, query.device):
            f, g = query[n, part], candidates[n]
            logits = torch.baddbmm(bias[n, None], f, g.transpose(1, 2))  # (n, q, M)
            q = gaussian_target(
                uv_px[n], on_object[n], target_uv_px[n, part], target_valid[n, part], sigma_px
            )
            weight = counts[n, part].to(query.dtype)  # (n, q)
            each, gradient = _DIVERGENCES[direction](logits, q)
            total += (each * weight).sum()
            gradient.mul_(weight[..., None])
            to_query[n, part] = gradient @ g
            to_candidates[n] += gradient.transpose(1, 2) @ f
            to_bias[n] += gradient.sum(dim=1)
        ctx.save_for_backward(to_query, to_candidates, to_bias)
        return total

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, grad: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        to_query, to_candidates, to_bias = ctx.saved_tensors
        return grad * to_query, grad * to_candidates, grad * to_bias, None, None, None, None


def _pieces(
    images: int, queries: int, candidates: int, chunk: int | None, device: torch.device
) -> Iterator[tuple[slice, slice]]:
    """Give out slices of images and of queries that are worked on together."""
    cached = device.type == "cpu"
    size = chunk or (max(1, _CACHED // max(1, candidates)) if cached else max(1, queries))
    step = 1 if cached else images
    for first in range(0, images, max(1, step)):
        for start in range(0, queries, size):
            yield slice(first, first + step), slice(start, start + size)


def _forward_divergence(logits: torch.Tensor, q: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return KL(q || p) of each query (n, q) and its gradient by the logits."""
    p = logits.softmax(dim=-1)
    normaliser = logits.amax(dim=-1) - p.amax(dim=-1).log()  # log sum exp, without its pass
    # Where q is 0 the floor keeps its logarithm finite, and 0 times it is 0.
    excess = q.clamp_min(_TINY).log_().sub_(logits).mul_(q)
    return excess.sum(dim=-1).add_(normaliser), p.sub_(q)


def _reverse_divergence(logits: torch.Tensor, q: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return KL(p || q) of each query (n, q) and its gradient by the logits."""
    p = logits.softmax(dim=-1)
    excess = logits.log_softmax(dim=-1).sub_(q.clamp_min_(_TINY).log_().clamp_min_(LOG_FLOOR))
    each = (p * excess).sum(dim=-1)
    return each, excess.sub_(each[..., None]).mul_(p)


_DIVERGENCES: Final = {"forward": _forward_divergence, "reverse": _reverse_divergence}
