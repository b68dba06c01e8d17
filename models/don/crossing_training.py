"""Learns which strand is seen at crossings from the frames of a training split.

The truth says where the rope crosses itself and which part of it each pixel shows. Middles and
widths are jittered as traces err, colours are mixed, blurred and made noisy, and patches mirrored.

A visible point on the side of the upper strand is on its edge, and the pixel around it may show
the lower strand: pixels nearer than 0.45 px to the upper strand count as its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt, gaussian_filter1d
from torch.nn import functional

from pliant.baselines.tracing import Crossing, self_crossings
from pliant.baselines.tracing.settings import TRACING
from pliant.loaders.frame_store import FrameStore
from pliant.loaders.views import TrainingFrame
from pliant.models.don.crossings import (
    LEAST_APART,
    REACH,
    SIDE,
    CrossingNetwork,
    distances,
    line_points,
)
from pliant.models.networks.patches import fit_patches, patches, recoloured, rotations, steps
from pliant.spec.arrays import Float32Array, FloatArray, RealArray

_BINS: Final = 100
_MOST_FRAMES: Final = 4000
_LEAST_CROSSINGS: Final = 20
_AROUND: Final = 2 * REACH  # half the side of what is kept of a crossing, half widths
_KEPT_SIDE: Final = 2 * SIDE
_ON_STRAND: Final = 0.05  # of the rope's length to the crossing, at most
_MIDDLE: Final = 0.8  # half widths from the crossing; the upper strand has most pixels there,
_CLEARLY: Final = 1.5  # more than so many times those of the lower one
_EDGE_PX: Final = 0.45
_INSIDE: Final = 0.2  # weight of pixels that are not near an edge; of those that are it is 1
_NEAR_EDGE: Final = 7  # pixels, the side of a square in which both strands are seen
_SHIFT, _TURN_RAD, _WIDTH = 0.1, 0.12, 0.1  # of a patch, standard deviations
_LINE_SHIFT, _LINE_TURN_RAD = 0.08, 0.03  # of the middles
_EPOCHS: Final = 16


class _Crossings(NamedTuple):
    """The surroundings of N crossings, in half widths of the rope.

    Attributes:
        seen: uint8 (N, 5, _KEPT_SIDE, _KEPT_SIDE): colours, where the first strand is seen, and
            where either is.
        lines: float (N, 2, L, 2), the middles of both strands from the crossing.
        direction: float (N, 2, 2), unit vectors along them.
    """

    seen: torch.Tensor
    lines: torch.Tensor
    direction: torch.Tensor


def fit_crossings(stores: Sequence[FrameStore], *, seed: int) -> CrossingNetwork | None:
    """Train a network for crossings.

    Args:
        stores: Frames of ropes at the dataset's own size.
        seed: Seed of all draws.

    Returns:
        The network; None where the frames show fewer than 20 crossings.
    """
    share = _MOST_FRAMES // len(stores)
    found = [each for store in stores for each in _labelled(store, share)]
    if len(found) < _LEAST_CROSSINGS:
        return None
    every = _Crossings(*(torch.stack(parts) for parts in zip(*found, strict=True)))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = CrossingNetwork()

        def loss(rows: torch.Tensor) -> torch.Tensor:
            planes, first, weight = _shown(_Crossings(*(each[rows] for each in every)))
            total = functional.binary_cross_entropy_with_logits(
                network(planes), first, weight, reduction="sum"
            )
            return total / weight.sum().clamp_min(1)

        fit_patches(network, loss, len(found), epochs=_EPOCHS)
        return network


def _labelled(store: FrameStore, most: int) -> Iterator[_Crossings]:
    """Yield the crossings of some frames whose upper strand is visible in the picture."""
    along = store.material[:, 0]
    for number in range(min(most, len(store))):
        surface, frame = store.frames[number].surface, store.view(number)
        middle = _middle_line(frame, along)
        if middle is None or surface is None:
            continue
        line, length_px = middle
        half_px = 0.5 * float(frame.mask.sum()) / length_px
        part = np.where(frame.mask, surface.m0, np.nan)
        for each in self_crossings(line, round(LEAST_APART * _BINS)):
            seen = _surroundings(frame, part, each, half_px)
            if seen is not None:
                yield _Crossings(
                    (seen * 255).round().to(torch.uint8),
                    torch.from_numpy(_lines(line, each) / half_px).float(),
                    torch.from_numpy(each.directions).float(),
                )


def _surroundings(
    frame: TrainingFrame, part: RealArray, crossing: Crossing, half_px: float
) -> torch.Tensor | None:
    """Return what `_Crossings.seen` has of a crossing, 0 to 1; None where its top is unclear."""
    off = [abs(part - (k + 1) / _BINS) for k in (crossing.first, crossing.second)]
    with np.errstate(invalid="ignore"):
        first = (off[0] < _ON_STRAND) & (off[0] <= off[1])
        second = (off[1] < _ON_STRAND) & (off[1] < off[0])
    rows, columns = np.indices(part.shape) + 0.5
    gap_px = np.hypot(columns - crossing.place_px[0], rows - crossing.place_px[1])
    middle = gap_px < _MIDDLE * half_px
    count = sorted([(first & middle).sum(), (second & middle).sum()])
    if count[1] <= _CLEARLY * count[0]:
        return None
    first_on_top = (first & middle).sum() == count[1]
    upper = first if first_on_top else second
    on_upper = distance_transform_edt(~upper) <= _EDGE_PX + 0.5  # from the middles of pixels
    labels = [on_upper if first_on_top else ~on_upper, first | second]
    planes: Float32Array = np.concatenate(
        [frame.rgb.astype(np.float32) / 255, np.stack(labels, axis=2)], axis=2, dtype=np.float32
    )
    return patches(
        planes,
        crossing.place_px[None],
        np.array([[1.0, 0.0]]),
        np.array([_AROUND * half_px]),
        _KEPT_SIDE,
    )[0]


def _lines(line: FloatArray, crossing: Crossing) -> FloatArray:
    """Return the middles of both strands around a crossing, from it, float64 (2, L, 2)."""
    reach = round(_ON_STRAND * _BINS)
    parts = [
        slice(max(0, at + 1 - reach), min(at + 2 + reach, len(line)))
        for at in (crossing.first, crossing.second)
    ]
    return line_points(line, parts) - crossing.place_px


def _middle_line(frame: TrainingFrame, along: RealArray) -> tuple[FloatArray, float] | None:
    """Return the rope's middle at 100 shares of its length, and that length, as traces have it, px.

    None if a stretch has no point.
    """
    bins = np.clip((along * _BINS).astype(np.int64), 0, _BINS - 1)
    count = np.bincount(bins, minlength=_BINS)
    if not count.all() or not np.isfinite(frame.uv_px).all():
        return None
    sums = [np.bincount(bins, frame.uv_px[:, axis], _BINS) for axis in (0, 1)]
    line = np.stack(sums, axis=1) / count[:, None]
    length_px = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) * _BINS / (_BINS - 1)
    return gaussian_filter1d(line, 1.0, axis=0, mode="nearest"), length_px


def _shown(kept: _Crossings) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return patches as `crossing_planes` makes them, changed at random, and what is right.

    Returns:
        The patches, float (N, 5, SIDE, SIDE); 1 where the first strand is seen, and how much that
        counts, 0 to 1, float (N, SIDE, SIDE): nothing where neither is seen or one is far away.
    """
    count = len(kept.seen)
    swapped = torch.rand(count) < 0.5
    lines = torch.where(swapped[:, None, None, None], kept.lines.flip(1), kept.lines)
    direction = torch.where(swapped[:, None], kept.direction[:, 1], kept.direction[:, 0])
    grid = _grid(direction)
    seen = functional.grid_sample(
        kept.seen / 255, grid / _AROUND, padding_mode="border", align_corners=False
    )
    turn = rotations(_LINE_TURN_RAD * torch.randn(count, 2))
    moved = torch.einsum("nkij,nklj->nkli", turn, lines)
    moved = moved + _LINE_SHIFT * torch.randn(count, 2, 1, 2)
    gaps = distances(grid, moved)
    rgb = recoloured(seen[:, None, :3])[:, 0]
    rgb = torch.where(torch.rand(count, 1, 1, 1) < 0.3, _blurred(rgb), rgb)
    first = (seen[:, 3] > 0.5) ^ swapped[:, None, None]
    doubtful = (seen[:, 4] > 0.5) & (gaps.amax(dim=1) < TRACING.crossing_near)
    spread = [
        functional.max_pool2d(each[:, None].float(), _NEAR_EDGE, 1, _NEAR_EDGE // 2)[:, 0]
        for each in (first, ~first)
    ]
    weight = doubtful * (_INSIDE + (1 - _INSIDE) * spread[0] * spread[1])
    return torch.cat([rgb, gaps], dim=1), first.float(), weight


def _grid(direction: torch.Tensor) -> torch.Tensor:
    """Return the pixel positions of patches along `direction`, float (N, SIDE, SIDE, 2)."""
    count = len(direction)
    along = torch.from_numpy(steps(REACH, SIDE)).float()
    y, x = torch.meshgrid(along, along, indexing="ij")
    mirrored = torch.where(torch.rand(count, 1, 1) < 0.5, -y, y)
    places = torch.stack([x.expand(count, -1, -1), mirrored], dim=-1)
    angle = torch.atan2(direction[:, 1], direction[:, 0]) + _TURN_RAD * torch.randn(count)
    angle = angle + torch.pi * (torch.rand(count) < 0.5)
    turned = torch.einsum("nij,nhwj->nhwi", rotations(angle), places)
    scale = torch.exp(_WIDTH * torch.randn(count, 1, 1, 1))
    return scale * turned + _SHIFT * torch.randn(count, 1, 1, 2)


def _blurred(picture: torch.Tensor) -> torch.Tensor:
    kernel = torch.tensor([1.0, 2.0, 1.0]) / 4
    flat = functional.pad(picture.flatten(0, 1)[:, None], (1, 1, 1, 1), mode="replicate")
    return functional.conv2d(flat, torch.outer(kernel, kernel)[None, None]).view_as(picture)
