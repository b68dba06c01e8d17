"""The losses: long cycles, skip cycles, similarity, and the self-cycle.

A patch of a clip's last frame is sought one frame back, what is found there another frame back,
and so on; then forward again to the last frame, where it should be where it was cut (Wang,
Jabri and Efros 2019, section 3.3). A skip cycle goes to an earlier frame and back in one step
each. Similarity is the product of the patch with what is found in an earlier frame. The
self-cycle seeks a turned and recoloured patch in the very frame it comes from, where the
right answer is known cell by cell.
"""

from __future__ import annotations

import torch

from pliant.models.timecycle.network import TimeCycleNetwork, cell_grid, place, soft_inlier
from pliant.models.timecycle.settings import CycleLossSettings

_FLOOR = 1e-4
_GRID = 20  # points along a side on which two placements are compared
_SPREAD_CELLS = 1.0  # of the place that counts as right in the self-cycle


def grid_error(placement: torch.Tensor, other: torch.Tensor, cells: int) -> torch.Tensor:
    """Return the squared distance of two placements on an aligned grid (the paper's l_theta).

    Args:
        placement: float (B, 3).
        other: float (B, 3).
        cells: Cells along a patch's side n.

    Returns:
        float (B,), mean over the grid, in squared sides of the patch.
    """
    grid = cell_grid(cells, placement.device, points=_GRID)
    gap = place(placement, grid) - place(other, grid)
    return gap.square().sum(dim=2).mean(dim=1) / cells**2


def cycle_losses(
    network: TimeCycleNetwork,
    frames: torch.Tensor,
    patch: torch.Tensor,
    start: torch.Tensor,
    weight: torch.Tensor,
    settings: CycleLossSettings,
) -> dict[str, torch.Tensor]:
    """Return the parts of the loss, not weighted yet.

    Args:
        network: Finds patches in frames.
        frames: float (N, T, D, h, w), unit descriptors of each patch's clip.
        patch: float (N, n n, D), unit descriptors of the patches.
        start: float (N, 3), where they were cut from the last frame.
        weight: float (N, n n), how much each cell counts, rows summing to 1.
        settings: Which parts have a weight; the others are left out.

    Returns:
        Scalars by name: `long`, `skip`, `similarity`, `self`; `long_cells` and `skip_cells`,
        without gradient, how far the centre ends from its start, cells.
    """

    def error(ends: torch.Tensor) -> torch.Tensor:
        starts = start.repeat(len(ends) // len(start), 1)
        return grid_error(ends, starts, network.cells).mean()

    last = frames.shape[1] - 1
    parts: dict[str, torch.Tensor] = {}
    found_at: dict[int, torch.Tensor] = {}
    if settings.long > 0 or settings.similarity > 0:
        backward = []
        found = patch
        for back in range(1, last + 1 if settings.long > 0 else 2):
            _, found, _ = network.locate(found, frames[:, last - back])
            backward.append(found)
        found_at[1] = backward[0]
        if settings.long > 0:
            ends = _forward(network, frames, backward)
            parts["long"] = error(ends)
            parts["long_cells"] = _centre_distance(ends, start)
    steps = range(2, last + 1) if last > 1 else range(1, 2)
    if settings.skip > 0 or settings.similarity > 0:
        there = torch.cat([frames[:, last - back] for back in steps])
        _, skipped, _ = network.locate(patch.repeat(len(steps), 1, 1), there)
        found_at |= dict(zip(steps, skipped.chunk(len(steps)), strict=True))
        if settings.skip > 0:
            home = frames[:, last].repeat(len(steps), 1, 1, 1)
            ends, _, _ = network.locate(skipped, home)
            parts["skip"] = error(ends)
            parts["skip_cells"] = _centre_distance(ends, start)
    if settings.similarity > 0:
        products = [((patch * found).sum(dim=2) * weight).sum(dim=1) for found in found_at.values()]
        parts["similarity"] = -torch.stack(products).mean()
    if settings.self_cycle > 0:
        _, _, affinities = network.locate(patch, frames[:, last])
        xy = place(start, cell_grid(network.cells, start.device))
        mass = soft_inlier(affinities, xy, network.size[0], _SPREAD_CELLS)
        parts["self"] = -((mass + _FLOOR).log() * weight).sum(dim=1).mean()
    return parts


def weighted_sum(parts: dict[str, torch.Tensor], settings: CycleLossSettings) -> torch.Tensor:
    """Return the loss: the parts times their weights."""
    weights = {
        "long": settings.long,
        "skip": settings.skip,
        "similarity": settings.similarity,
        "self": settings.self_cycle,
    }
    return torch.stack([weights[name] * parts[name] for name in weights if name in parts]).sum()


def _forward(
    network: TimeCycleNetwork, frames: torch.Tensor, backward: list[torch.Tensor]
) -> torch.Tensor:
    """Bring what was found 1 to k frames back forward to the last frame, all lengths at once.

    Returns:
        Placements (k N, 3) in the last frame, shortest cycle first.
    """
    last = frames.shape[1] - 1
    lengths = len(backward)
    ends = []
    current = backward  # cycles that are still on their way, by length
    for step in range(1, lengths + 1):
        # A cycle of length i stands at frame last - i + step - 1 and goes one on.
        going = range(step, lengths + 1)
        there = torch.cat([frames[:, last - length + step] for length in going])
        placement, found, _ = network.locate(torch.cat(current), there)
        count = len(frames)
        ends.append(placement[:count])
        current = list(found.split(count))[1:]
    return torch.cat(ends)


def _centre_distance(ends: torch.Tensor, start: torch.Tensor) -> torch.Tensor:
    start = start.repeat(len(ends) // len(start), 1)
    return (ends[:, :2] - start[:, :2]).norm(dim=1).mean().detach()
