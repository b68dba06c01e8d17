"""Bridges over the gaps of a mask, where the rope is covered.

Loose ends that face each other are one rope. Of two ends with the directions d and e, out of the
mask, and the vector g from the first to the second one, the cost is

    angle(d, g')^2 + angle(e, -g')^2 + 0.02 |g| / h,

with h half of the rope's width. Between different parts g' is g + 2 h (d - e), which leads from
inside of one strand to inside of the other, since the line across a narrow gap that is cut at a
slant says nothing; within one part it is g. Those bridges are built, one at each end, whose costs
are together farthest below a limit: between parts, or between further ends of one part, but not
those of short strands, which a ragged edge has. They must not close a part to a ring while another
one is left. With a ball, one end alone is free, so that dearer bridges are built too, and those of
a loop in a mask of one part. A bridge is a band as wide as the rope along the cubic Hermite curve
with these directions.

An end may also point at a strand nearby, where the mask has a gap at a crossing. A ball is an end
without a direction where it is away from its rope, or only a rest of the rope is at it; so are both
ends of a stub, which is as wide as long. Two ends at the border of the picture are joined outside
of it; how the rope turns there is unknown, so that their angles cost nothing. Where the table is
seen, nothing hides a rope: 0.22 of the length counts there instead of 0.02.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from PIL import Image, ImageDraw
from scipy import ndimage

from pliant.baselines.tracing.ends import Ball
from pliant.baselines.tracing.mask_shape import MARGIN
from pliant.baselines.tracing.settings import TRACING
from pliant.baselines.tracing.strands import Skeleton, Strand
from pliant.spec.arrays import BoolArray, FloatArray, IntArray, Mask

TableSeen = Callable[[FloatArray], BoolArray]
"""float64 (N, 2), places in image pixels -> bool (N,), whether the table is seen there."""

_BALL: Final = 0  # the number of its part
_STATIONS: Final = 24
# An end within these radii of the ball and two half widths is the one at the ball.
_BESIDE_BALL: Final = 1.6


@dataclass(frozen=True, eq=False)
class _End:
    """A loose end of a mask.

    Attributes:
        part: The number of the connected part.
        place: float64 (2,), (u, v).
        outward: float64 (2,), the unit vector out of the mask; None of a ball or a stub.
        at_border: Whether the rope leaves the picture there.
        strand: Length of its strand, half widths of the rope: a ragged edge has short ones.
        joint: Whether it is a place on a strand that another end points at.
    """

    part: int
    place: FloatArray
    outward: FloatArray | None
    at_border: bool = False
    strand: float = math.inf
    joint: bool = False

    def turn(self, way: FloatArray) -> float | None:
        """Return the angle between its direction and a unit vector, rad, if it has one."""
        if self.outward is None:
            return None
        return float(np.arccos(np.clip(self.outward @ way, -1, 1)))


def exits(mask: Mask) -> int:
    """Return how many times a mask meets the border of its picture."""
    reach = 1 + round(TRACING.border_px)
    top, bottom = mask[:reach].any(axis=0), mask[-reach:].any(axis=0)
    left, right = mask[:, :reach].any(axis=1), mask[:, -reach:].any(axis=1)
    ring = np.concatenate([top, right, bottom[::-1], left[::-1]])
    return int((ring & ~np.roll(ring, 1)).sum())


def bridged(
    mask: Mask,
    small: Mask,
    factor: int,
    half_px: float,
    ball: Ball | None,
    margin: int = 0,
    table: TableSeen | None = None,
) -> Mask:
    """Return a rope's mask with its gaps bridged; one without gaps is returned itself.

    Args:
        mask: bool (H, W), the rope.
        small: bool (h, w), the same with fewer pixels.
        factor: Pixels of `mask` per pixel of `small`.
        half_px: About half of the rope's width, pixels of `small`.
        ball: The rope's ball, in pixels of `mask`, or None.
        margin: Empty rows and columns of `mask` around the picture, for bridges outside.
        table: Where the table is seen, in pixels of `mask`, or None.
    """
    labels, _ = ndimage.label(small, np.ones((3, 3)))
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    large = sizes >= TRACING.bridge_least * half_px**2
    parts = [int(k) for k in np.flatnonzero(large)]
    is_one = len(parts) < 2 and ball is None and not margin
    if is_one or len(parts) > TRACING.bridge_parts:
        return mask
    ends = [end for part in parts for end in _loose_ends(labels == part, half_px, part)]
    if ball is not None:
        middle, radius = ball.middle_px / factor, ball.radius_px / factor
        ends = _away_from_ball(ends, labels, middle, radius, half_px)
    if margin:
        size_px = np.array(mask.shape[::-1], dtype=np.float64)
        ends = [
            _with_border(end, end.place * factor - margin, size_px - 2 * margin, half_px * factor)
            for end in ends
        ]

    free = 2 if ball is None else 1
    known = large[labels] * labels
    strands = [(end, _strand_ahead(end, known, half_px)) for end in ends]
    costs: dict[tuple[_End, _End], float] = {}
    for one, other in [*itertools.combinations(ends, 2), *strands]:
        if other is None:
            continue
        left = len(ends) - (1 if other.joint else 2)
        if one.part != other.part or left >= free:
            bare = 0.0 if table is None else _bare(_curve(one, other), small, table, factor)
            costs[one, other] = _cost(one, other, half_px, bare)
    bridges = _bridges(ends, costs, free)
    if not bridges:
        return mask
    picture = Image.fromarray(mask).convert("L")
    drawing = ImageDraw.Draw(picture)
    width = max(1, round(2 * half_px / MARGIN * factor))
    for one, other in bridges:
        curve = _curve(one, other) * factor - 0.5  # Pillow has pixel centres at whole numbers
        drawing.line([tuple(place) for place in curve], fill=255, width=width, joint="curve")
    return np.asarray(picture) > 0


def _away_from_ball(
    ends: list[_End], labels: IntArray, middle: FloatArray, radius: float, half_px: float
) -> list[_End]:
    """Return the ends that are not at the ball, and the ball where nothing else leads from it.

    Args:
        ends: The loose ends.
        labels: int (h, w), the number of each pixel's part, 0 outside of the mask.
        middle: float64 (2,), (u, v), of the ball.
        radius: Of the ball.
        half_px: Half of the rope's width.
    """
    near = _BESIDE_BALL * radius + 2 * half_px
    ends = [end for end in ends if np.linalg.norm(end.place - middle) > near]
    pixels = np.argwhere(labels > 0)
    gap = np.linalg.norm(pixels[:, ::-1] + 0.5 - middle, axis=1)
    own = int(labels[tuple(pixels[gap.argmin()])])
    if gap.min() - radius > TRACING.bridge_ball * half_px:
        own = _BALL
    alone = all(end.part != own for end in ends)
    return [*ends, _End(own, middle, None)] if alone else ends


def _loose_ends(mask: Mask, half_px: float, part: int) -> Iterator[_End]:
    skeleton = Skeleton.of(np.pad(mask, 1), half_px, TRACING.strands_most)
    reach = max(2, round(TRACING.bridge_reach * skeleton.half_px))
    leaving: dict[int, list[tuple[Strand, int]]] = {}
    for strand in skeleton.strands:
        for end in (0, 1):
            leaving.setdefault(strand.nodes[end], []).append((strand, end))
    for (strand, end), *others in leaving.values():
        if others:
            continue
        line = strand.line[:: 1 - 2 * end]
        onward = [each for each in leaving[strand.nodes[1 - end]] if each[0] is not strand]
        if len(onward) == 1:  # the node is that of a spur
            further, entered = onward[0]
            line = np.concatenate([line, further.line[:: 1 - 2 * entered]])
        length = len(line) / skeleton.half_px
        outward = None
        if length >= TRACING.bridge_stub:
            outward = -replace(strand, line=line).leaving(0, reach)
        yield _End(part, skeleton.in_mask(line[0]) - 1, outward, strand=length)


def _with_border(end: _End, place_px: FloatArray, size_px: FloatArray, half_px: float) -> _End:
    """Return an end that knows whether it is at the border of its picture, (width, height)."""
    away_px = float(np.minimum(place_px, size_px - place_px).min())
    reach_px = (1 + TRACING.border_reach) * half_px + TRACING.border_px + 1
    return replace(end, at_border=away_px < reach_px)


def _strand_ahead(end: _End, labels: IntArray, half_px: float) -> _End | None:
    """Return the middle of the strand that an end points at nearby, as an end, or None.

    Args:
        end: The end.
        labels: int (h, w), the number of each pixel's part, 0 outside of the mask.
        half_px: Half of the rope's width.
    """
    if end.outward is None or end.at_border:
        return None
    left = False
    for step in range(math.ceil((TRACING.bridge_ahead + 2) * half_px)):
        column, row = np.floor(end.place + step * end.outward).astype(np.int64)
        if not (0 <= row < labels.shape[0] and 0 <= column < labels.shape[1]):
            return None
        part = int(labels[row, column])
        if left and part:
            middle = end.place + (step + half_px) * end.outward
            return _End(part, middle, None, joint=True)
        left |= part == 0
    return None


def _bridges(
    ends: list[_End], costs: dict[tuple[_End, _End], float], free: int
) -> list[tuple[_End, _End]]:
    """Return the pairs of ends that are bridged: those whose costs are most below the limit.

    Args:
        ends: The loose ends.
        costs: What each possible bridge costs, rad².
        free: Ends that stay loose.
    """
    most = TRACING.bridge_most_at_ball if free == 1 else TRACING.bridge_most
    gains = {  # a joint takes one end, where others take two
        (one, other): most / (2 if other.joint else 1) - cost
        for (one, other), cost in costs.items()
    }
    ranked = sorted((pair for pair in gains if gains[pair] > 0), key=lambda pair: -gains[pair])
    ranked = ranked[: TRACING.bridge_pairs]
    best: list[tuple[_End, _End]] = []
    largest = 0.0

    def look(first: int, gain: float, chosen: list[tuple[_End, _End]]) -> None:
        nonlocal best, largest
        if gain > largest and _is_one_rope(chosen, ends, costs, free):
            best, largest = chosen, gain
        taken = {end for pair in chosen for end in pair}
        for number, pair in enumerate(ranked[first:], first):
            more = gains[pair]
            if gain + (len(ends) - len(taken)) * more <= largest:
                return
            if taken.isdisjoint(pair):
                look(number + 1, gain + more, [*chosen, pair])

    look(0, 0.0, [])
    return best


def _is_one_rope(
    bridges: list[tuple[_End, _End]],
    ends: list[_End],
    costs: dict[tuple[_End, _End], float],
    free: int,
) -> bool:
    """Return whether bridges, those that gain most first, leave what can be one rope.

    Parts that they close to a ring, or to a strand of their own, cannot where there are others.
    """
    most = TRACING.bridge_most_at_ball if free == 1 else TRACING.bridge_own
    loose = set(ends).difference(*bridges)
    group = {end.part: end.part for end in itertools.chain(ends, *bridges)}
    on_itself = False
    for one, other in bridges:
        first, second = group[one.part], group[other.part]
        if first == second:
            short = min(one.strand, other.strand) <= TRACING.bridge_strand
            if short or len(loose) < free or costs[one, other] >= most:
                return False
            on_itself |= other.joint
        group = {part: first if own == second else own for part, own in group.items()}
    groups = set(group.values())
    return len(groups) == 1 or (groups == {group[end.part] for end in loose} and not on_itself)


def _cost(one: _End, other: _End, half_px: float, bare: float = 0.0) -> float:
    """Return the cost of a bridge, rad², along a share of which the table is seen."""
    gap = other.place - one.place
    length = max(float(np.linalg.norm(gap)), 1e-6)
    cost = (TRACING.bridge_length + TRACING.bridge_bare * bare) * length / half_px
    if one.at_border and other.at_border:
        return cost
    if one.part != other.part and one.outward is not None and other.outward is not None:
        gap = gap + TRACING.bridge_back * half_px * (one.outward - other.outward)
    way = gap / max(float(np.linalg.norm(gap)), 1e-6)
    turns = [one.turn(way), other.turn(-way)]
    known = [turn**2 for turn in turns if turn is not None]
    if other.joint:
        cost += TRACING.bridge_joint
    return cost + 2 * sum(known) / max(len(known), 1)


def _bare(curve: FloatArray, mask: Mask, table: TableSeen, factor: int) -> float:
    """Return the share of a curve (N, 2), outside of the mask, along which the table is seen."""
    column, row = np.floor(curve).astype(np.int64).T
    height, width = mask.shape
    column, row = column.clip(0, width - 1), row.clip(0, height - 1)
    outside = curve[~mask[row, column]]
    return float(table(outside * factor).mean()) if len(outside) else 0.0


def _curve(one: _End, other: _End) -> FloatArray:
    """Return places on the curve from one end to another, float64 (N, 2)."""
    gap = other.place - one.place
    length = float(np.linalg.norm(gap))
    first = gap if one.outward is None else length * one.outward
    last = gap if other.outward is None else -length * other.outward
    s = np.linspace(0, 1, _STATIONS)[:, None]
    return np.asarray(
        (2 * s**3 - 3 * s**2 + 1) * one.place
        + (s**3 - 2 * s**2 + s) * first
        + (3 * s**2 - 2 * s**3) * other.place
        + (s**3 - s**2) * last
    )
