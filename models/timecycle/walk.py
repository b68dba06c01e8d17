"""The contrastive random walk: a walker between frames must return to the node it left.

Source: Jabri, Owens and Efros, Space-Time Correspondence as a Contrastive Random Walk, 2020,
sections 2.1 to 2.3. The nodes of a frame are squares of cells, and an edge's probability is the
softmax of the products of descriptors. A walk goes k frames back in time and the same way home; its
end is judged by the cross entropy with where it began. Edges are dropped at random.

A network that knows nothing but the place in the picture comes home too. So the way home may lead
through copies of the frames, each turned in its own way (after the label warping of Shrivastava and
Owens, Self-Supervised Any-Point Tracking by Contrastive Random Walks, 2024): in the earliest frame
the walker steps from the nodes to the copy's nodes at the same places, and at the end it must be at
the copy's nodes where its first node is.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch.nn import functional

from pliant.models.timecycle.settings import WalkSettings

_DROPPED = -1e4
_FLOOR = 1e-12
_SPREAD = 0.3  # of a node's side: how exactly a place in the copy is a node's


@dataclass(frozen=True)
class WayHome:
    """Turned copies of the frames of a batch of clips.

    Attributes:
        frames: float (B, T, D, h, w), unit descriptors.
        mask: bool (B, T, H, W), the object.
        place: float (B, T, h w, 2), where the cells of the frames are in the copies, cells.
    """

    frames: torch.Tensor
    mask: torch.Tensor
    place: torch.Tensor


@dataclass(frozen=True)
class _Nodes:
    """The nodes of a batch of clips.

    Attributes:
        described: float (B, T, M, D), of unit length.
        place: float (B, T, M, 2), where they are, cells.
        number: int64 (B, T, M), their numbers among all nodes of a frame.
        off: bool (B, T, M), nodes that no edge leads to, or None.
    """

    described: torch.Tensor
    place: torch.Tensor
    number: torch.Tensor
    off: torch.Tensor | None


def walk_loss(
    frames: torch.Tensor,
    interest: torch.Tensor,
    settings: WalkSettings,
    generator: torch.Generator | None = None,
    mask: torch.Tensor | None = None,
    home: WayHome | None = None,
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
        home: The frames that the walk returns through; None for the same ones.

    Returns:
        `walk`, the mean over walks of 1 to T - 1 frames and back; `walk_home`, without gradient,
        the share of the longest walks whose most probable end is where they should end.
    """
    nodes = _nodes(frames, _cell_centres(frames), settings, mask)
    weight = _weight(nodes, interest, frames, settings)
    returning, carried = nodes, None
    if home is not None:
        returning = _nodes(home.frames, _cell_centres(frames), settings, home.mask)
        place = _nodes(frames, home.place, settings, mask).place
        carried = [_carried(place[:, t], returning, t, settings) for t in range(frames.shape[1])]
    last = frames.shape[1] - 1
    count = nodes.described.shape[2]
    there = torch.eye(count, device=frames.device).expand(len(frames), -1, -1)
    goal = there if carried is None else carried[last]  # (B, M, M')
    back = torch.eye(goal.shape[2], device=frames.device).expand(len(frames), -1, -1)
    losses, arrived = [], back.new_zeros(())
    for earlier in reversed(range(last)):
        there = there @ _transition(nodes, earlier + 1, earlier, settings, generator)
        back = _transition(returning, earlier, earlier + 1, settings, generator) @ back
        middle = there if carried is None else there @ carried[earlier]
        ends = middle @ back  # (B, M, M')
        found = (goal * (ends + _FLOOR).log()).sum(dim=2)
        losses.append(-(found * weight).sum(dim=1).mean())
        home_at = ends.argmax(dim=2) == goal.argmax(dim=2)
        arrived = (home_at * weight).sum(dim=1).mean()
    return {"walk": torch.stack(losses).mean(), "walk_home": arrived.detach()}


def _cell_centres(frames: torch.Tensor) -> torch.Tensor:
    """Return the centres of the cells of frames, (B, T, h w, 2)."""
    height, width = frames.shape[-2:]
    u = torch.arange(width, device=frames.device) + 0.5
    v = torch.arange(height, device=frames.device) + 0.5
    centres = torch.stack([u.repeat(height), v.repeat_interleave(width)], dim=1)
    return centres.expand(*frames.shape[:2], -1, -1)


def _pooled(cells: torch.Tensor, frames: torch.Tensor, settings: WalkSettings) -> torch.Tensor:
    """Return the means over nodes (N, M, C) of what cells (N, h w, C) have."""
    maps = cells.transpose(1, 2).unflatten(2, frames.shape[-2:])
    return functional.avg_pool2d(maps, settings.nodes).flatten(2).transpose(1, 2)


def _nodes(
    frames: torch.Tensor, place: torch.Tensor, settings: WalkSettings, mask: torch.Tensor | None
) -> _Nodes:
    """Return the mean descriptors of squares of cells; on the object alone where it is asked."""
    pooled = functional.avg_pool2d(frames.flatten(0, 1), settings.nodes)
    described = functional.normalize(pooled, dim=1).flatten(2).transpose(1, 2)
    described = described.unflatten(0, frames.shape[:2])  # (B, T, M, D)
    at = _pooled(place.flatten(0, 1), frames, settings).unflatten(0, frames.shape[:2])
    number = torch.arange(described.shape[2], device=frames.device)
    number = number.expand(*frames.shape[:2], -1)
    if not settings.on_object or mask is None:
        return _Nodes(described, at, number, None)
    touched = functional.adaptive_max_pool2d(mask.float(), pooled.shape[-2:]).flatten(2)
    count = max(1, int(touched.sum(dim=2).max()))
    kept = touched.topk(count, dim=2)  # (B, T, K), the object's nodes first
    index = kept.indices[..., None]
    return _Nodes(
        described.take_along_dim(index, dim=2),
        at.take_along_dim(index, dim=2),
        kept.indices,
        kept.values == 0,
    )


def _weight(
    nodes: _Nodes, interest: torch.Tensor, frames: torch.Tensor, settings: WalkSettings
) -> torch.Tensor:
    """Return how much walks from the last frame's nodes count, (B, M), rows summing to 1."""
    every = _pooled(interest[..., None], frames, settings)[..., 0]
    weight = every.take_along_dim(nodes.number[:, -1], dim=1)
    if nodes.off is not None:
        weight = weight * ~nodes.off[:, -1]
    return weight / weight.sum(dim=1, keepdim=True).clamp_min(_FLOOR)


def _carried(
    place: torch.Tensor, returning: _Nodes, frame: int, settings: WalkSettings
) -> torch.Tensor:
    """Return the probabilities (B, M, M') of the copy's nodes at the places of nodes (B, M, 2)."""
    square = torch.cdist(place, returning.place[:, frame]).square()
    logits = -square / (2 * (_SPREAD * settings.nodes) ** 2)
    if returning.off is not None:
        logits = logits.masked_fill(returning.off[:, None, frame], 2 * _DROPPED)
    return logits.softmax(dim=2)


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
