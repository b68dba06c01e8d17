"""The pixelwise contrastive loss of Dense Object Nets (Schmidt 2016, Florence et al. 2018).

For a query with descriptor f, its match g and non-matches h_k, with margin M:

    L = mean over matches ||f - g||^e  +  sum_k max(0, M - ||f - h_k||)^e / (number counted)

e is 2 (`squared`, as in the code of Dense Object Nets) or 1. The number counted is that of the
hard non-matches, those inside the margin (`hard_scaling`), or of all of them. A non-match within
`guard_px` of the match (or of a symmetry partner of it) is none: it is left out and not counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch.utils.checkpoint import checkpoint

from pliant.models.losses.matches import NonMatches, Targets

_TINY = 1e-12


@dataclass(frozen=True)
class Hinge:
    """How matches are pulled and non-matches pushed away.

    Attributes:
        margin: M, > 0.
        guard_px: Radius around a match inside which nothing is a non-match.
        squared: Whether distances of matches and hinges are squared.
        hard_scaling: Whether to divide by the hard non-matches alone.
    """

    margin: float = 0.5
    guard_px: float = 2.0
    squared: bool = True
    hard_scaling: bool = True


def contrastive_loss(
    query: torch.Tensor,
    match: torch.Tensor,
    valid: torch.Tensor,
    non_matches: NonMatches,
    targets: Targets,
    hinge: Hinge = Hinge(),
    chunk: int | None = None,
) -> torch.Tensor:
    """Return the contrastive loss of a batch.

    Args:
        query: float (N, Q, D), descriptors of the queries.
        match: float (N, Q, D), descriptors at their matches.
        valid: bool (N, Q), which queries have a match.
        non_matches: Other pixels and their descriptors.
        targets: Where the match and its symmetry partners are.
        hinge: How non-matches are pushed away.
        chunk: Queries at a time, recomputed in the backward pass; None for all at once.

    Returns:
        A scalar; 0 if no query has a match.
    """
    inputs = (
        query,
        match,
        valid,
        non_matches.descriptors,
        non_matches.uv_px,
        targets.uv_px,
        targets.valid,
    )
    size = chunk or query.shape[1]
    total = query.new_zeros(3)
    for start in range(0, query.shape[1], size):
        piece = [tensor[:, start : start + size] for tensor in inputs]
        total = total + (
            _sums(hinge, *piece)
            if chunk is None
            else checkpoint(_sums, hinge, *piece, use_reentrant=False)
        )
    return total[0] / valid.sum().clamp_min(1) + total[1] / total[2].detach().clamp_min(1)


def _sums(hinge: Hinge, *piece: torch.Tensor) -> torch.Tensor:
    """Return (sum over matches, sum over non-matches, non-matches counted) of some queries."""
    query, match, valid, non_match, non_match_uv, match_uv, match_valid = piece
    # sqrt has no gradient at 0: a collapsed network would yield NaN.
    pull = ((query - match) ** 2).sum(dim=-1)  # (N, q)
    pull = pull if hinge.squared else (pull + _TINY).sqrt()
    gap = (non_match_uv[:, :, :, None] - match_uv[:, :, None]).norm(dim=-1)  # (N, q, K, R)
    near = ((gap <= hinge.guard_px) & match_valid[:, :, None]).any(dim=-1)  # (N, q, K)
    counted = valid[..., None] & ~near
    square = ((query[:, :, None] - non_match) ** 2).sum(dim=-1)
    inside = (hinge.margin - (square + _TINY).sqrt()).clamp_min(0)
    push = inside**2 if hinge.squared else inside
    number = (counted & (inside > 0)) if hinge.hard_scaling else counted
    return torch.stack([(pull * valid).sum(), (push * counted).sum(), number.sum().to(push.dtype)])


def draw_non_matches(
    mask: torch.Tensor, queries: int, count: int, generator: torch.Generator | None = None
) -> torch.Tensor:
    """Draw places to be non-matches: the first half on the object, the rest anywhere else.

    They are anywhere in their pixels, as matches are. Descriptors between pixels are means of
    those of four pixels: if non-matches were at the pixels' centres, a network could tell them
    from matches by this alone, with descriptors that vary from pixel to pixel.

    Args:
        mask: bool (N, h, w), the object.
        queries: Q.
        count: K, places for each query, at least 2.
        generator: Source of randomness, on the mask's device.

    Returns:
        float (N, Q, K, 2), (u, v) in pixels of the mask. An image with nothing on one side of the
        mask is drawn from as a whole.
    """
    flat = mask.flatten(1)
    picked = []
    for side, number in ((flat, count // 2), (~flat, count - count // 2)):
        usable = torch.where(side.any(dim=1, keepdim=True), side, torch.ones_like(side))
        drawn = torch.multinomial(
            usable.float(), queries * number, replacement=True, generator=generator
        )
        picked.append(drawn.view(len(mask), queries, number))
    pixel = torch.cat(picked, dim=-1)
    width = mask.shape[-1]
    corner = torch.stack([pixel % width, pixel // width], dim=-1)
    return corner + torch.rand(corner.shape, generator=generator, device=mask.device)
