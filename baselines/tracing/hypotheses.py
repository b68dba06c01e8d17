"""The candidate paths (*readings*) of one rope in a mask, each with its statistics."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image, ImageFilter

from pliant.baselines.tracing.bridging import TableSeen, bridged, exits
from pliant.baselines.tracing.centring import Centred, centred, evenly_spaced
from pliant.baselines.tracing.chain import Evidence, sampled_paths
from pliant.baselines.tracing.crossings import Overlap
from pliant.baselines.tracing.ends import Ball, from_end_to_end
from pliant.baselines.tracing.mask_shape import (
    depth_in_mask,
    farthest_pixels,
    half_width_px,
    shrunk,
    working_factor,
)
from pliant.baselines.tracing.settings import TRACING
from pliant.baselines.tracing.strands import straightest_paths
from pliant.baselines.tracing.tilt import Nadir, small_tilt
from pliant.baselines.tracing.walk import walks
from pliant.spec.arrays import FloatArray, Mask
from pliant.spec.ball import without_small_holes
from pliant.spec.mask_box import mask_box

Likelihood = Callable[[FloatArray], FloatArray]
"""float64 (N, 2), places in image pixels -> float64 (N, T), > 0, the likelihood of what is
seen there at each of T steps along the rope; 1 where nothing is known."""


@dataclass(frozen=True)
class Trace:
    """One reading of a rope in an image.

    Attributes:
        uv_px: float64 (S, 2), evenly spaced from the first end to the last, image pixels.
        length_px: Its length, image pixels.
        half_px: Half of the rope's width, image pixels.
        coverage: Share of the mask that a rope along it covers, 0 to 1.
        retraced: Share of its stations where it follows an earlier part of itself.
        nadir: Where the camera looks straight down.
        overlaps: Where it crosses itself, and which part is seen there, as far as that is known.
        cut: Whether the rope leaves the picture at its first and at its last end.
        comes_back: Whether it leaves the picture in between.
    """

    uv_px: FloatArray
    length_px: float
    half_px: float
    coverage: float
    retraced: float
    nadir: Nadir
    overlaps: tuple[Overlap, ...] = ()
    cut: tuple[bool, bool] = (False, False)
    comes_back: bool = False

    @property
    def score(self) -> float:
        """How plausible it is, in units of coverage; 1 at most."""
        doubts = TRACING.retraced_weight * self.retraced + TRACING.bend_weight * self.bend
        return self.coverage - doubts

    @functools.cached_property
    def bend(self) -> float:
        """Sum of its squared turns, rad², between chords of one width."""
        every = round(2 * self.half_px / self.length_px * (len(self.uv_px) - 1))
        chords = np.diff(self.uv_px[:: max(1, every)], axis=0)
        heading = np.arctan2(chords[:, 1], chords[:, 0])
        return float((np.diff(np.unwrap(heading)) ** 2).sum())

    @functools.cached_property
    def axes(self) -> FloatArray:
        """The unit vectors along and across it at its stations, float64 (S, 2, 2)."""
        way = np.gradient(self.uv_px, axis=0)
        way /= np.linalg.norm(way, axis=1, keepdims=True) + 1e-9
        return np.stack([way, np.stack([-way[:, 1], way[:, 0]], axis=1)], axis=1)

    @functools.cached_property
    def sight(self) -> FloatArray:
        """How the line of sight leans along and across it, tangents of angles, (S, 2)."""
        aside = (self.uv_px - self.nadir.below_px) / self.nadir.focal_px
        return np.asarray(np.einsum("nij,nj->ni", self.axes, aside))


def rope_traces(
    mask: Mask,
    objects: Mask | None = None,
    likelihood: Likelihood | None = None,
    nadir: Nadir | None = None,
    table: TableSeen | None = None,
) -> list[Trace]:
    """Return the ways to read a mask as one rope.

    Gaps in it are bridged first, and a rope that leaves the picture and comes back is joined
    outside (`bridging.py`). Readings are walks along the mask (`walk.py`) and the straightest paths
    along all of its strands (`strands.py`). They start at the rope's ball where there is one, and
    at both ends otherwise. With a likelihood, paths sampled from the model of `chain.py` are added:
    they need no start.

    Args:
        mask: bool (H, W), the rope.
        objects: bool (H, W), the rope and its ball; None or no more than the rope without a ball.
        likelihood: What is seen at places of the image says of where along the rope they are.
        nadir: Where the camera looks straight down; None for the middle of the image.
        table: Where the picture shows the table, so that nothing hides a rope there.

    Returns:
        Traces, the most plausible first; empty where the mask shows no rope.
    """
    nadir = nadir or Nadir.of_image(mask.shape)
    if exits(mask) < 2:
        return _readings(mask, objects, likelihood, nadir, 0, table)
    size, margin = mask.shape[::-1], round(TRACING.border_margin * max(mask.shape))
    shown = None if objects is None else np.pad(objects, margin)
    around = None if likelihood is None else lambda uv_px: likelihood(uv_px - margin)
    bare = None if table is None else lambda uv_px: table(uv_px - margin)
    traces = _readings(np.pad(mask, margin), shown, around, nadir.scaled(1.0, margin), margin, bare)
    return [_without_margin(trace, margin, size) for trace in traces]


def _without_margin(trace: Trace, margin_px: int, size: tuple[int, ...]) -> Trace:
    uv_px = trace.uv_px - margin_px
    comes_back = bool(((uv_px[1:-1] < 0) | (uv_px[1:-1] > size)).any())
    nadir = trace.nadir.scaled(1.0, -margin_px)
    return replace(trace, uv_px=uv_px, nadir=nadir, comes_back=comes_back)


def _readings(
    mask: Mask,
    objects: Mask | None,
    likelihood: Likelihood | None,
    nadir: Nadir,
    margin: int,
    table: TableSeen | None,
) -> list[Trace]:
    """Return the traces of a mask around whose picture `margin` pixels were added."""
    factor = working_factor(mask)
    small = shrunk(mask, factor)
    if small.sum() < TRACING.shortest_steps:
        return []
    covering = np.zeros_like(mask) if objects is None else objects & ~mask
    opened = _opened(shrunk(covering, factor))
    ball = Ball.of_mask(opened, factor) if opened.any() else None
    shown = mask
    depth = depth_in_mask(small)
    half_px = half_width_px(depth)
    without_gaps = bridged(mask, small, factor, half_px, ball, margin, table)
    if without_gaps is not mask:
        mask, small = without_gaps, shrunk(without_gaps, factor)
        depth = depth_in_mask(small)
        half_px = half_width_px(depth)
    whole_px = half_width_px(depth_in_mask(without_small_holes(small)))
    starts = _starts_at_ends(small) if ball is None else [_start_at_ball(small, ball, factor)]
    paths = _walked(depth, half_px, starts)
    paths += straightest_paths(small, half_px, None if ball is None else starts[0][0])
    paths = [path * factor for path in paths]
    about_px = half_px * factor
    if likelihood is not None:
        deep_px = max(float(np.percentile(depth[small], 80)), 0.8)
        length_px = float(small.sum() / (2 * deep_px)) * factor
        coarse = max(factor, int(about_px / TRACING.chain_half_px))
        paths += _sampled(mask, shown, covering, likelihood, length_px, coarse)
    if not paths:
        return []
    middles = centred(paths, mask, about_px)
    below = _tilted(nadir, middles)
    traces = []
    for middle in middles.places_px:
        whole = from_end_to_end(middle, mask, about_px, ball)
        traces.append(_measured(whole, small, whole_px, factor, middles.usual_px / 2, below))
    long = [trace for trace in traces if trace.length_px > 0]  # a rope that is one pixel is none
    return sorted(long, key=lambda trace: -trace.score)


def _sampled(
    mask: Mask, shown: Mask, covering: Mask, likelihood: Likelihood, length_px: float, factor: int
) -> list[FloatArray]:
    """Return paths sampled from the model of `chain.py`, float64 (T, 2) each, (u, v) in pixels.

    The model is given blocks of pixels: its cost grows with their number.

    Args:
        mask: bool (H, W), the rope, without gaps.
        shown: bool (H, W), the rope as it is seen.
        covering: bool (H, W), other objects, which may hide it.
        likelihood: What is seen says of where along the rope it is.
        length_px: Length of the rope if no part of it hides another.
        factor: Side of a block, px.
    """
    rope, seen, other = (shrunk(each, factor) for each in (mask, shown, covering))
    if not rope.any():
        return []
    pixels = np.argwhere(rope | other)
    found = likelihood((pixels[:, ::-1] + 0.5) * factor)
    found[~(seen | other)[tuple(pixels.T)]] = 1.0  # what covers the rope says nothing of it
    evidence = Evidence(pixels, rope[tuple(pixels.T)], found)
    sampled = sampled_paths(evidence, length_px / factor, TRACING.chain_samples)
    return [path * factor for path in sampled]


def _walked(
    depth: FloatArray, half_px: float, starts: Sequence[tuple[FloatArray, FloatArray]]
) -> list[FloatArray]:
    """Return the walks that are long enough, from each start with every setting of a walker."""
    relative = np.minimum(depth, half_px) / half_px
    settings = np.array(list(itertools.product(TRACING.walk_straightness, TRACING.walk_inertia)))
    places, headings = (np.stack(each) for each in zip(*starts, strict=True))
    walked = walks(relative, places, headings, settings[:, 0], settings[:, 1])
    return [path for path in walked if len(path) >= TRACING.shortest_steps]


def _opened(mask: Mask) -> Mask:
    """Remove parts thinner than five pixels from a mask, unless all of it is thinner."""
    if not mask.any():
        return mask
    box = mask_box(mask, 8)
    picture = Image.fromarray(mask[box]).convert("L")
    opened = picture.filter(ImageFilter.MinFilter(5)).filter(ImageFilter.MaxFilter(5))
    thick = np.zeros_like(mask)
    thick[box] = np.asarray(opened) > 0
    return thick if thick.any() else mask


def _centres(mask: Mask) -> FloatArray:
    rows, columns = np.nonzero(mask)
    return np.stack([columns, rows], axis=1) + 0.5


def _start_at_ball(mask: Mask, ball: Ball, factor: int) -> tuple[FloatArray, FloatArray]:
    """Return the rope's pixel nearest to the ball's middle, and the way that the rope takes."""
    middle, places = ball.middle_px / factor, _centres(mask)
    start = places[np.linalg.norm(places - middle, axis=1).argmin()]
    return start, _heading(places, start, start - middle)


def _starts_at_ends(mask: Mask) -> list[tuple[FloatArray, FloatArray]]:
    """Return both ends: the pixels farthest from each other along the mask."""
    places = _centres(mask)
    starts = [np.array([column, row]) + 0.5 for row, column in farthest_pixels(mask)]
    return [(start, _heading(places, start, np.zeros(2))) for start in starts]


def _heading(places: FloatArray, start: FloatArray, otherwise: FloatArray) -> FloatArray:
    """Return the unit vector to the middle of the mask around a place.

    Args:
        places: float64 (N, 2), the mask.
        start: float64 (2,), the place.
        otherwise: float64 (2,), the way to take where that middle is the place; 0 for any.
    """
    near = places[np.linalg.norm(places - start, axis=1) < TRACING.heading_px]
    way = near.mean(axis=0) - start
    if np.linalg.norm(way) < 0.5:
        way = otherwise if otherwise.any() else np.array([1.0, 0.0])
    return np.asarray(way / np.linalg.norm(way))


def _tilted(nadir: Nadir, middles: Centred) -> Nadir:
    """Return the nadir with the tilt that the widths along all paths show."""
    usual = middles.usual
    places, normals = middles.places_px[usual], middles.normals[usual]
    widths = middles.widths_px[usual]
    return replace(
        nadir, tilt=small_tilt(places, normals, widths, nadir, TRACING.alike * len(usual))
    )


def _measured(
    path_px: FloatArray, mask: Mask, half_px: float, factor: int, rope_half_px: float, nadir: Nadir
) -> Trace:
    in_image, length_px = evenly_spaced(path_px, TRACING.stations, nadir)
    stations = in_image / factor
    covered = _covered(stations, mask.shape, half_px + 1)
    return Trace(
        uv_px=in_image,
        length_px=length_px,
        half_px=rope_half_px,
        nadir=nadir,
        coverage=float(covered[mask].mean()),
        retraced=_retraced(stations[::3]),
    )


def _retraced(places: FloatArray) -> float:
    """Return the share of places (N, 2) at which a line follows another part of itself."""
    number = np.arange(len(places))
    apart = np.abs(np.subtract.outer(number, number)) > 0.07 * len(places)
    way = np.gradient(places, axis=0)
    spacing = np.linalg.norm(way, axis=1, keepdims=True)
    way /= spacing + 1e-9
    parallel = np.abs(way @ way.T) > 0.9
    gap = places[None] - places[:, None]  # from a place (row) to each other one
    along = np.einsum("ijk,ik->ij", gap, way)
    across = np.einsum("ijk,ik->ij", gap, way[:, ::-1] * [-1, 1])
    there = (np.abs(along) <= spacing) & (np.abs(across) < 2)
    return float((there & parallel & apart).any(axis=1).mean())


def _covered(stations: FloatArray, shape: tuple[int, ...], radius_px: float) -> Mask:
    """Return the pixels within a radius of any station."""
    reach = int(np.ceil(radius_px))
    offsets = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2), axis=-1).reshape(-1, 2)
    offsets = offsets[np.linalg.norm(offsets, axis=1) <= radius_px]
    column, row = (np.floor(stations).astype(np.int64)[:, None] + offsets).reshape(-1, 2).T
    inside = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
    covered = np.zeros(shape, dtype=np.bool_)
    covered[row[inside], column[inside]] = True
    return covered
