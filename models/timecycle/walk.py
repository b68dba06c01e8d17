"""The contrastive random walk: a walker between frames must return to the node it left.

Source: Jabri, Owens and Efros, Space-Time Correspondence as a Contrastive Random Walk, 2020,
sections 2.1 to 2.3. The nodes of a frame are squares of cells, and an edge's probability is the
softmax of the products of descriptors. A walk goes k frames back in time and the same way home; its
end is judged by the cross entropy with where it began. Edges are dropped at random.
"""

from __future__ import annotations

import torch
from torch.nn import functional

from pliant.models.timecycle.settings import WalkSettings

_DROPPED = -1e4
_FLOOR = 1e-12


def walk_loss(
    frames: torch.Tensor,
    interest: torch.Tensor,
    settings: WalkSettings,
    generator: torch.Generator | None = None,
) -> dict[str, torch.Tensor]:
    """Return the loss of a batch of clips.

    Args:
        frames: float (B, T, D, h, w), unit descriptors.
        interest: float (B, h w), how much a walk that begins at each cell of the last frame
            counts, rows summing to 1.
        settings: Size of the nodes, temperature, dropout.
        generator: Source of randomness for dropped edges, on the device of the frames; None drops
            none.

    Returns:
        `walk`, the mean over walks of 1 to T - 1 frames and back; `walk_home`, without gradient,
        the share of the longest walks whose most probable end is their beginning.
    """
    nodes = _nodes(frames, settings.nodes)  # (B, T, M, D)
    height, width = frames.shape[-2:]
    start = functional.avg_pool2d(interest.unflatten(1, (height, width)), settings.nodes)
    weight = start.flatten(1) / start.flatten(1).sum(dim=1, keepdim=True).clamp_min(_FLOOR)
    length = frames.shape[1]
    eye = torch.eye(nodes.shape[2], device=nodes.device).expand(len(nodes), -1, -1)
    there, back, losses, home = eye, eye, [], eye.new_zeros(())
    for step in range(1, length):
        later, earlier = nodes[:, length - step], nodes[:, length - 1 - step]
        there = there @ _transition(later, earlier, settings, generator)
        back = _transition(earlier, later, settings, generator) @ back
        ends = there @ back  # (B, M, M)
        returned = ends.diagonal(dim1=1, dim2=2)
        losses.append(-((returned + _FLOOR).log() * weight).sum(dim=1).mean())
        own = torch.arange(ends.shape[1], device=ends.device)
        home = ((ends.argmax(dim=2) == own) * weight).sum(dim=1).mean()
    return {"walk": torch.stack(losses).mean(), "walk_home": home.detach()}


def _nodes(frames: torch.Tensor, side: int) -> torch.Tensor:
    """Return the mean descriptors of squares of cells, of unit length, (B, T, M, D)."""
    pooled = functional.avg_pool2d(frames.flatten(0, 1), side)
    nodes = functional.normalize(pooled, dim=1).flatten(2).transpose(1, 2)
    return nodes.unflatten(0, frames.shape[:2])


def _transition(
    source: torch.Tensor,
    target: torch.Tensor,
    settings: WalkSettings,
    generator: torch.Generator | None,
) -> torch.Tensor:
    """Return the probabilities (B, M, M) of a step from each node of one frame to the other's."""
    logits = source @ target.transpose(1, 2) / settings.temperature
    if settings.dropout > 0 and generator is not None:
        draws = torch.rand(logits.shape, generator=generator, device=logits.device)
        logits = logits.masked_fill(draws < settings.dropout, _DROPPED)
    return logits.softmax(dim=2)
