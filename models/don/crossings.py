"""Over and under: which strand is seen where a rope crosses itself, for the traces of a view.

A network sees a patch of the image that is turned so that the first strand runs along its x axis,
in units of half the rope's width. Next to its colours it sees how far each pixel is from the middle
of either strand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import torch

from pliant.baselines.tracing import Crossing, Overlap, Trace, VisibleStrand, self_crossings
from pliant.models.networks.patches import normalised, patches, steps
from pliant.models.networks.unet import UNet
from pliant.spec.arrays import BoolArray, Float32Array, FloatArray
from pliant.spec.frame import Frame

SIDE: Final = 48
"""Pixels along each side of a patch."""

REACH: Final = 3.0
"""Half the side of a patch, in half widths of the rope."""

_FARTHEST: Final = 3.0  # distances beyond it, in half widths, look alike


def crossing_planes(
    picture: Float32Array,
    place_px: FloatArray,
    directions: FloatArray,
    lines_px: FloatArray,
    half_px: float,
) -> torch.Tensor:
    """Sample the surroundings of crossings.

    Args:
        picture: float32 (H, W, 3), colours from 0 to 1.
        place_px: float64 (N, 2), the crossings.
        directions: float64 (N, 2), unit vectors along the first strand.
        lines_px: float64 (N, 2, L, 2), the middles of both strands around the crossing.
        half_px: Half the rope's width.

    Returns:
        float32 (N, 5, SIDE, SIDE): colours, and the distances to either middle in half widths.
    """
    seen = patches(picture, place_px, directions, np.full(len(place_px), REACH * half_px), SIDE)
    axes = np.stack([directions, np.stack([-directions[:, 1], directions[:, 0]], axis=1)], axis=1)
    turned = np.einsum("nij,nklj->nkli", axes, (lines_px - place_px[:, None, None]) / half_px)
    along = steps(REACH, SIDE)
    grid = torch.from_numpy(np.stack(np.meshgrid(along, along), axis=-1)).float()
    lines = torch.from_numpy(turned).float()
    gaps = distances(grid.expand(len(lines), -1, -1, -1), lines)
    return torch.cat([seen, gaps], dim=1)


def distances(places: torch.Tensor, lines: torch.Tensor) -> torch.Tensor:
    """Return how far places (N, h, w, 2) are from polylines (N, K, L, 2), float (N, K, h, w)."""
    start, step = lines[:, :, :-1], lines.diff(dim=2)
    apart = places.flatten(1, 2)[:, None, :, None] - start[:, :, None]  # (N, K, hw, L - 1, 2)
    step = step[:, :, None]
    share = (apart * step).sum(-1) / (step.square().sum(-1) + 1e-9)
    nearest = apart - share.clamp(0, 1)[..., None] * step
    gap = nearest.square().sum(-1).amin(-1).sqrt()
    return gap.unflatten(2, (places.shape[1], places.shape[2]))


class CrossingNetwork(UNet):
    """Log odds that the first strand of a crossing is seen and not the second one."""

    def __init__(self) -> None:
        super().__init__(3 + 2, 1, widths=(24, 32, 48), global_blocks=0, patch=2)

    def forward(self, planes: torch.Tensor) -> torch.Tensor:
        """Look at patches by `crossing_planes`, (N, 5, h, w); returns log odds, float (N, h, w)."""
        gaps = _FARTHEST / 2 - planes[:, 3:].clamp(max=_FARTHEST)
        return super().forward(torch.cat([normalised(planes[:, :3]), gaps], dim=1))[:, 0]


CROSSINGS: Final = "crossings.safetensors"
"""The weights of a run's `CrossingNetwork`."""

LEAST_APART: Final = 0.04
"""Passages nearer along the rope, as a share of its length, do not count as a crossing."""

LINE_POINTS: Final = 11
"""Points of a strand's middle that the network is shown."""

_MOST_CROSSINGS: Final = 12  # a trace with more runs along itself
_LINE_REACH: Final = 1.45 * REACH  # half widths: past the corners of a patch
_SAME_PLACE: Final = 0.5  # largest distance of crossings of two traces that are one, half widths
_SAME_WAY: Final = 0.95  # least cosine of the angle between their strands


@dataclass(frozen=True)
class _Met:
    """A crossing of a trace with the stretches that meet there."""

    crossing: Crossing
    parts: tuple[slice, slice]
    lines_px: FloatArray  # (2, LINE_POINTS, 2)

    def order(self, other: _Met, half_px: float) -> int:
        """Return 1 if another one is the same, -1 if it is with its strands exchanged, or 0."""
        own, others = self.crossing, other.crossing
        if np.linalg.norm(own.place_px - others.place_px) > _SAME_PLACE * half_px:
            return 0
        cosine = np.abs(own.directions @ others.directions.T)
        straight, exchanged = cosine.diagonal(), cosine[::-1].diagonal()
        if max(straight.min(), exchanged.min()) < _SAME_WAY:
            return 0
        return 1 if straight.sum() >= exchanged.sum() else -1


def with_overlaps(
    network: CrossingNetwork, view: Frame, mask: BoolArray, traces: Sequence[Trace]
) -> list[Trace]:
    """Return traces that know which of their parts are seen where they cross.

    Args:
        network: Trained.
        view: The image.
        mask: bool (h, w), the rope, at any size.
        traces: Its readings, in pixels of the image, the most plausible first.
    """
    picture = view.rgb.astype(np.float32) / 255
    factor = picture.shape[1] / mask.shape[1]
    area_px2 = float(mask.sum()) * factor**2
    seen: list[tuple[_Met, VisibleStrand]] = []
    known = []
    for trace in traces:
        half_px = 0.5 * area_px2 / trace.length_px
        overlaps = []
        for met in _meetings(trace, half_px):
            orders = (met.order(other, half_px) for other, _ in seen)
            number, order = next(((n, o) for n, o in enumerate(orders) if o), (len(seen), 1))
            if number == len(seen):
                seen.append((met, _look(network, picture, met, half_px)))
            first, second = met.parts[::order]
            overlaps.append(Overlap(first, second, half_px, seen[number][1]))
        known.append(replace(trace, overlaps=tuple(overlaps)))
    return known


def _meetings(trace: Trace, half_px: float) -> list[_Met]:
    stations = len(trace.uv_px)
    reach = math.ceil(_LINE_REACH * half_px / trace.length_px * (stations - 1))
    met = self_crossings(trace.uv_px, round(LEAST_APART * stations))

    def around(crossing: Crossing) -> _Met:
        first, second = (
            slice(max(0, at - reach), min(stations, at + reach + 1))
            for at in (crossing.first, crossing.second)
        )
        return _Met(crossing, (first, second), line_points(trace.uv_px, (first, second)))

    return [around(each) for each in met] if len(met) <= _MOST_CROSSINGS else []


def line_points(line_px: FloatArray, parts: Sequence[slice]) -> FloatArray:
    """Return parts of a line (N, 2) as inputs of the network, float64 (K, LINE_POINTS, 2)."""
    return np.stack(
        [
            line_px[np.linspace(part.start, part.stop - 1, LINE_POINTS).round().astype(np.int64)]
            for part in parts
        ]
    )


def _look(
    network: CrossingNetwork, picture: Float32Array, met: _Met, half_px: float
) -> VisibleStrand:
    place_px, direction = met.crossing.place_px, met.crossing.directions[0]
    planes = crossing_planes(picture, place_px[None], direction[None], met.lines_px[None], half_px)
    with torch.inference_mode():
        square = network(planes)[0].numpy()
    return VisibleStrand(place_px, direction, REACH * half_px, square)
