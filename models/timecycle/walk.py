"""The contrastive random walk: a walker between frames must return to the node it left.

Source: Jabri, Owens and Efros, Space-Time Correspondence as a Contrastive Random Walk, 2020,
sections 2.1 to 2.3. The nodes of a frame are squares of cells, and an edge's probability is the
softmax of the products of descriptors. A walk goes k frames back in time and the same way home; its
end is judged by the cross entropy with where it began. Edges are dropped at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch.nn import functional

from pliant.models.timecycle.settings import WalkSettings

_DROPPED = -1e4
_FLOOR = 1e-12


@dataclass(frozen=True)
class _Nodes:
    """The nodes of a batch of clips.

    Attributes:
        described: float (B, T, M, D), of unit length.
        weight: float (B, M), how much walks from the last frame's nodes count, rows summing to 1.
        off: bool (B, T, M), nodes that no edge leads to, or None.
    """

    described: torch.Tensor
    weight: torch.Tensor
    off: torch.Tensor | None


def walk_loss(
    frames: torch.Tensor,
    interest: torch.Tensor,
    settings: WalkSettings,
    generator: torch.Generator | None = None,
    mask: torch.Tensor | None = None,
) -> dict[str, torch.Tensor]:
    """Return the loss of a batch of clips.

    Args:
        frames: float (B, T, D, h, w), unit descriptors.
        interest: float (B, h w), how much a walk that begins at each cell of the last frame
            counts, rows summing to 1.
        settings: Size of the nodes, temperature, dropout.
        generator: Source of randomness for dropped edges, on the device of the frames; None drops
            none.
        mask: bool (B, T, H, W), where the object is; `settings.on_object` needs it.

    Returns:
        `walk`, the mean over walks of 1 to T - 1 frames and back; `walk_home`, without gradient,
        the share of the longest walks whose most probable end is their beginning.
    """
    nodes = _nodes(frames, interest, settings, mask)
    length = frames.shape[1]
    eye = torch.eye(nodes.described.shape[2], device=frames.device).expand(len(frames), -1, -1)
    there, back, losses, home = eye, eye, [], eye.new_zeros(())
    for step in range(1, length):
        later, earlier = length - step, length - 1 - step
        there = there @ _transition(nodes, later, earlier, settings, generator)
        back = _transition(nodes, earlier, later, settings, generator) @ back
        ends = there @ back  # (B, M, M)
        returned = ends.diagonal(dim1=1, dim2=2)
        losses.append(-((returned + _FLOOR).log() * nodes.weight).sum(dim=1).mean())
        own = torch.arange(ends.shape[1], device=ends.device)
        home = ((ends.argmax(dim=2) == own) * nodes.weight).sum(dim=1).mean()
    return {"walk": torch.stack(losses).mean(), "walk_home": home.detach()}


def _nodes(
    frames: torch.Tensor,
    interest: torch.Tensor,
    settings: WalkSettings,
    mask: torch.Tensor | None,
) -> _Nodes:
    """Return the mean descriptors of squares of cells; on the object alone where it is asked."""
    pooled = functional.avg_pool2d(frames.flatten(0, 1), settings.nodes)
    described = functional.normalize(pooled, dim=1).flatten(2).transpose(1, 2)
    described = described.unflatten(0, frames.shape[:2])  # (B, T, M, D)
    start = functional.avg_pool2d(interest.unflatten(1, frames.shape[-2:]), settings.nodes)
    weight, off = start.flatten(1), None
    if settings.on_object and mask is not None:
        touched = functional.adaptive_max_pool2d(mask.float(), pooled.shape[-2:]).flatten(2)
        count = max(1, int(touched.sum(dim=2).max()))
        kept = touched.topk(count, dim=2)  # (B, T, K), the object's nodes first
        described = described.take_along_dim(kept.indices[..., None], dim=2)
        off = kept.values == 0
        weight = weight.take_along_dim(kept.indices[:, -1], dim=1) * kept.values[:, -1]
    return _Nodes(described, weight / weight.sum(dim=1, keepdim=True).clamp_min(_FLOOR), off)


def _transition(
    nodes: _Nodes,
    source: int,
    target: int,
    settings: WalkSettings,
    generator: torch.Generator | None,
) -> torch.Tensor:
    """Return the probabilities (B, M, M) of a step from each node of one frame to the other's."""
    products = nodes.described[:, source] @ nodes.described[:, target].transpose(1, 2)
    logits = products / settings.temperature
    if settings.dropout > 0 and generator is not None:
        draws = torch.rand(logits.shape, generator=generator, device=logits.device)
        logits = logits.masked_fill(draws < settings.dropout, _DROPPED)
    if nodes.off is not None:
        logits = logits.masked_fill(nodes.off[:, None, target], 2 * _DROPPED)
    return logits.softmax(dim=2)
