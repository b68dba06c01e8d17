"""Whether the colour images show the objects where the surface images have them.

At the silhouette of an object colour changes from one pixel to the next, more than it does a few
pixels away on either side. The contrast at the silhouette over that 5 and 6 pixels away is clearly
above 1 for the right picture and about 1 for another one; the shift at which it is largest tells
by how much a picture was moved. No colour can be proved wrong by low contrast alone, so that is a
warning. It is an error if another explanation fits better than chance explains: a shift, a turned
picture, another frame's. Places of a silhouette are resampled in blocks for this.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray, Rgb

REACH: Final = 6
"""Pixels to either side at which contrast is measured."""

EDGES: Final = 128
"""So many places of a silhouette are measured along each image axis."""

MIN_EDGES: Final = 24
"""Fewer places of an axis say nothing."""

MIN_RATIO: Final = 1.3
"""Contrast at the silhouette over that away from it, below which nothing is recognised."""

SURE_RATIO: Final = 1.5
"""The same for another explanation to be believed; it is also so much better than the data."""

SHIFT_GAIN: Final = 1.25
"""Contrast at the best shift over that at none, from which the picture counts as shifted."""

MAX_FRAMES: Final = 16
"""Frames of a sequence that are measured, spread over it."""

BLOCKS: Final = 12
BLOCK_PX: Final = (4, 8)
"""Blocks along the shorter side, and their least and largest side in pixels: the places of one
block count as one observation."""

MIN_BLOCKS: Final = 4
"""From fewer blocks nothing is certain."""

SHIFTS: Final = 2 * (2 * REACH + 1)
"""So many shifts are tried: a probability is corrected for all of them."""

CERTAIN: Final = 1e-4
DOUBTFUL: Final = 1e-2
"""Corrected probability that chance gives a shift: below this it is an error, or a warning."""

SIDE: Final = 3e-3
"""Probability that chance gives the gain of one side of the objects: above it, a shift is not
certain. The shadow of a thin rope darkens one side and gives the other a weak gain."""

ALTERNATIVES: Final = 5
"""So many other explanations than a shift are tried."""

_AWAY: Final = [0, 1, -2, -1]

_TURNS: Final[tuple[tuple[str, Callable[[Rgb], Rgb]], ...]] = (
    ("upside down", lambda rgb: rgb[::-1]),
    ("mirrored", lambda rgb: rgb[:, ::-1]),
    ("turned by 180 degrees", lambda rgb: rgb[::-1, ::-1]),
)


@dataclass(frozen=True)
class Edges:
    """The contrast at places of a silhouette along one image axis, at shifts of -6 to 6 px.

    Attributes:
        contrast: float64 (N, 13).
        enters: bool (N,), True where the object begins, False where it ends.
        block: int64 (N,), the part of the picture that a place is in: places of one block have
            one texture and one light, and count as one observation.
    """

    contrast: FloatArray
    enters: npt.NDArray[np.bool_]
    block: npt.NDArray[np.int64]

    def mean(self) -> FloatArray:
        """Return the mean contrast, float64 (13,); NaN if there are too few places."""
        if len(self.contrast) < MIN_EDGES:
            return np.full(2 * REACH + 1, np.nan)
        return np.asarray(self.contrast.mean(axis=0))

    @classmethod
    def joined(cls, parts: Sequence[Edges]) -> Edges:
        """Return the places of several pictures, each on the scale of its mean contrast."""
        parts = [part for part in parts if len(part.contrast) >= MIN_EDGES]
        if not parts:
            return cls(np.zeros((0, 2 * REACH + 1)), np.zeros(0, np.bool_), np.zeros(0, np.int64))
        return cls(
            np.concatenate(
                [part.contrast / max(float(part.contrast.mean()), 1e-9) for part in parts]
            ),
            np.concatenate([part.enters for part in parts]),
            np.concatenate([part.block for part in parts]),
        )


def probability(gain: FloatArray, block: npt.NDArray[np.int64]) -> float:
    """Return how likely a mean this much above 0 is if the true one is 0 (one-sided t test).

    Its error is estimated by resampling blocks, not places (the cluster-robust variance).

    Args:
        gain: float64 (N,).
        block: int64 (N,).
    """
    from scipy.special import stdtr

    _, index = np.unique(block, return_inverse=True)
    count = int(index.max()) + 1 if index.size else 0
    if count < MIN_BLOCKS:
        return 1.0
    mean = float(gain.mean())
    sums = np.bincount(index, gain - mean)
    error = float(np.sqrt((sums**2).sum() * count / (count - 1))) / gain.size
    return float(stdtr(count - 1, -mean / max(error, 1e-12)))


@dataclass(frozen=True)
class Silhouette:
    """Places where an object begins or ends.

    Attributes:
        across: (rows, columns), each int64 (N,), of the pixel left of an edge.
        down: The same of the pixel above an edge.
        seen: bool (H, W), where an object is seen.
    """

    across: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]
    down: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]
    seen: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, seen: npt.NDArray[np.bool_]) -> Silhouette:
        """Find some edges between object and background, spread over the image.

        Args:
            seen: bool (H, W), where an object is seen.
        """
        height, width = seen.shape
        across = _spread(seen[:, 1:] != seen[:, :-1], (0, height), (REACH, width - REACH - 1))
        down = _spread(seen[1:] != seen[:-1], (REACH, height - REACH - 1), (0, width))
        return cls(across, down, seen)

    def edges(self, rgb: Rgb) -> tuple[Edges, Edges]:
        """Measure a picture along u and v."""
        steps = np.arange(-REACH, REACH + 2)
        side = int(np.clip(min(self.seen.shape) // BLOCKS, *BLOCK_PX))
        found = []
        for axis, (rows, columns) in enumerate((self.across, self.down)):
            if axis == 0:
                strip = rgb[rows[:, None], columns[:, None] + steps]
            else:
                strip = rgb[rows[:, None] + steps, columns[:, None]]
            contrast = np.abs(np.diff(strip.astype(np.int16), axis=1)).sum(2).astype(np.float64)
            block = rows // side * self.seen.shape[1] + columns // side
            found.append(Edges(contrast, ~self.seen[rows, columns], block))
        return found[0], found[1]


def _spread(
    edge: npt.NDArray[np.bool_], rows: tuple[int, int], columns: tuple[int, int]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    inner = edge[rows[0] : rows[1], columns[0] : columns[1]]
    place = np.flatnonzero(inner)
    if place.size > EDGES:
        place = place[np.linspace(0, place.size - 1, EDGES).astype(np.int64)]
    i, j = np.divmod(place, inner.shape[1])
    return i + rows[0], j + columns[0]


def profile(edges: Sequence[Edges]) -> FloatArray:
    """Return the mean contrast along u and v, float64 (2, 13)."""
    return np.array([each.mean() for each in edges])


def recognised(contrast: FloatArray) -> float:
    """Return the contrast at no shift over that 5 and 6 pixels away; NaN if unknown."""
    away = contrast[:, _AWAY].mean(axis=1)
    middle = contrast[:, REACH]
    known = np.isfinite(away)
    return float((middle[known].sum() + 1.0) / (away[known].sum() + 1.0)) if known.any() else np.nan


def shift_of(edges: Edges) -> tuple[int, float]:
    """Return the shift along an axis at which the contrast is larger than at none, and its doubt.

    A picture that is moved has both sides of an object moved the same way, unlike a shadow or a
    line inside the object.

    Returns:
        The shift in px, 0 if there is none; the probability that chance gives it, corrected for
        all shifts tried, at least `CERTAIN` if chance explains the gain of one side.
    """
    mean = edges.mean()
    if not np.isfinite(mean).all():
        return 0, 1.0
    best = int(np.argmax(mean))
    if mean[best] <= SHIFT_GAIN * mean[REACH] or mean[best] <= SURE_RATIO * mean[_AWAY].mean():
        return 0, 1.0
    gain = edges.contrast[:, best] - edges.contrast[:, REACH]
    sides = (edges.enters, ~edges.enters)
    if any(not side.any() or gain[side].mean() <= 0 for side in sides):
        return 0, 1.0
    doubt = SHIFTS * probability(gain, edges.block)
    if max(probability(gain[side], edges.block[side]) for side in sides) > SIDE:
        doubt = max(doubt, CERTAIN)
    return best - REACH, doubt


@dataclass(frozen=True)
class _Alternative:
    """Another explanation of a picture: how well it fits, and its gain place by place."""

    ratio: float
    gain: FloatArray
    block: npt.NDArray[np.int64]

    @classmethod
    def of(cls, own: Sequence[Edges], other: Sequence[Edges]) -> _Alternative:
        gains = []
        for mine, theirs in zip(own, other, strict=True):
            if len(mine.contrast):
                first, second = (
                    e.contrast[:, REACH] / max(float(e.contrast[:, _AWAY].mean()), 1.0)
                    for e in (mine, theirs)
                )
                gains.append(second - first)
        return cls(
            recognised(profile(other)),
            np.concatenate(gains),
            np.concatenate([each.block for each in own]),
        )


@dataclass
class Colours:
    """What the colour images of a sequence show, frame by frame.

    Attributes:
        own: Each picture at its own silhouette, along u and v.
        others: Name of an explanation -> how it fits the frames measured.
    """

    own: list[tuple[Edges, Edges]] = field(default_factory=list)
    others: dict[str, list[_Alternative]] = field(default_factory=dict)
    _last: tuple[int, Rgb, Silhouette] | None = None

    def add(self, frame: int, rgb: Rgb, seen: npt.NDArray[np.bool_]) -> None:
        """Measure a frame whose surface image fits its points."""
        silhouette = Silhouette.of(seen)
        edges = silhouette.edges(rgb)
        ratio = recognised(profile(edges))
        if not np.isfinite(ratio):
            return
        self.own.append(edges)
        if ratio < SURE_RATIO:
            for name, turn in _TURNS:
                other = _Alternative.of(edges, silhouette.edges(turn(rgb)))
                self.others.setdefault(f"the pictures are {name}", []).append(other)
        if self._last is not None and self._last[0] == frame - 1:
            _, picture, outline = self._last
            before = self.own[-2]
            if min(ratio, recognised(profile(before))) < SURE_RATIO:
                for name, other in (
                    ("before", _Alternative.of(edges, silhouette.edges(picture))),
                    ("after", _Alternative.of(before, outline.edges(rgb))),
                ):
                    text = f"a silhouette is that of the picture of the frame {name}"
                    self.others.setdefault(text, []).append(other)
        self._last = (frame, rgb, silhouette)

    def explain(self) -> tuple[bool, str] | None:
        """Return (certain, what is wrong with the pictures); None if nothing is."""
        if not self.own:
            return None
        found = [shift_of(Edges.joined([each[axis] for each in self.own])) for axis in (0, 1)]
        chance = min(doubt for _, doubt in found)
        if chance < DOUBTFUL:
            u, v = (step if doubt < DOUBTFUL else 0 for step, doubt in found)
            return chance < CERTAIN, (
                f"the silhouettes are seen ({u:+d}, {v:+d}) px (u, v) from where the surface "
                "images have them: shifted pictures?"
            )
        ratios = np.array([recognised(profile(edges)) for edges in self.own])
        low = ratios < MIN_RATIO
        other = self._explained(ratios, low) if low.any() else None
        if other is not None:
            return True, other
        if np.mean(low) < 0.5:
            return None
        return False, (
            f"in {np.count_nonzero(low)} of {low.size} frames the colour changes no more at the "
            f"silhouette than 5 px away (ratio {float(np.median(ratios)):.2f}): pictures of other "
            "frames, or an object that its background hides?"
        )

    def _explained(self, ratios: FloatArray, low: npt.NDArray[np.bool_]) -> str | None:
        for text, found in self.others.items():
            best = float(np.median([other.ratio for other in found]))
            gain = np.concatenate([other.gain for other in found])
            block = np.concatenate([other.block for other in found])
            sure = best > SURE_RATIO and best > SURE_RATIO * float(np.median(ratios[low]))
            if sure and probability(gain, block) < CERTAIN / ALTERNATIVES:
                return f"{text} (contrast ratio {best:.1f}, as they are {np.median(ratios):.1f})"
        return None


def is_blank(rgb: Rgb) -> bool:
    """Return whether a picture is one colour, up to two steps of each channel."""
    few = rgb[::16, ::16]  # usually enough to see that it is not
    return all(np.ptp(part.reshape(-1, 3), axis=0).max() <= 2 for part in (few, rgb))
