"""Whether the colour images show the objects where the surface images have them.

At the silhouette of an object colour changes from one pixel to the next, more than it does a few
pixels away on either side. The contrast at the silhouette over that 5 and 6 pixels away is clearly
above 1 for the right picture and about 1 for another one; the shift at which it is largest tells
by how much a picture was moved. No colour can be proved wrong by low contrast alone, so that is a
warning. It is an error if another explanation fits: a shift, a turned picture, another frame's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

Rgb = npt.NDArray[np.uint8]
FloatArray = npt.NDArray[np.float64]

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

_TURNS: Final[tuple[tuple[str, Callable[[Rgb], Rgb]], ...]] = (
    ("upside down", lambda rgb: rgb[::-1]),
    ("mirrored", lambda rgb: rgb[:, ::-1]),
    ("turned by 180 degrees", lambda rgb: rgb[::-1, ::-1]),
)


@dataclass(frozen=True)
class Silhouette:
    """Places where an object begins or ends.

    Attributes:
        across: (rows, columns), each int64 (N,), of the pixel left of an edge.
        down: The same of the pixel above an edge.
    """

    across: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]
    down: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]

    @classmethod
    def of(cls, seen: npt.NDArray[np.bool_]) -> Silhouette:
        """Find some edges between object and background, spread over the image.

        Args:
            seen: bool (H, W), where an object is seen.
        """
        height, width = seen.shape
        rows, columns = _spread(
            seen[:, 1:] != seen[:, :-1], (0, height), (REACH, width - REACH - 1)
        )
        other = _spread(seen[1:] != seen[:-1], (REACH, height - REACH - 1), (0, width))
        return cls((rows, columns), other)

    def contrast(self, rgb: Rgb) -> FloatArray:
        """Return the mean contrast at shifts -6 to 6 along u and v, float64 (2, 13); NaN: none."""
        steps = np.arange(-REACH, REACH + 2)
        found = np.full((2, 2 * REACH + 1), np.nan)
        for axis, (rows, columns) in enumerate((self.across, self.down)):
            if len(rows) < MIN_EDGES:
                continue
            if axis == 0:
                strip = rgb[rows[:, None], columns[:, None] + steps]
            else:
                strip = rgb[rows[:, None] + steps, columns[:, None]]
            found[axis] = np.abs(np.diff(strip.astype(np.int16), axis=1)).sum(2).mean(0)
        return found


def _spread(
    edge: npt.NDArray[np.bool_], rows: tuple[int, int], columns: tuple[int, int]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    if rows[1] <= rows[0] or columns[1] <= columns[0]:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    inner = edge[rows[0] : rows[1], columns[0] : columns[1]]
    place = np.flatnonzero(inner)
    if place.size > EDGES:
        place = place[np.linspace(0, place.size - 1, EDGES).astype(np.int64)]
    i, j = np.divmod(place, max(1, inner.shape[1]))
    return i + rows[0], j + columns[0]


def recognised(contrast: FloatArray) -> float:
    """Return the contrast at no shift over that 5 and 6 pixels away; NaN if unknown."""
    away = contrast[:, [0, 1, -2, -1]].mean(axis=1)
    middle = contrast[:, REACH]
    known = np.isfinite(away)
    return float((middle[known].sum() + 1.0) / (away[known].sum() + 1.0)) if known.any() else np.nan


def best_shift(contrast: FloatArray) -> tuple[int, int]:
    """Return the shift (u, v) at which contrast is clearly larger than at none, else 0, in px."""
    shift = [0, 0]
    for axis, profile in enumerate(contrast):
        if np.isfinite(profile).all():
            best = int(np.argmax(profile))
            away = profile[[0, 1, -2, -1]].mean()
            if profile[best] > SHIFT_GAIN * profile[REACH] and profile[best] > SURE_RATIO * away:
                shift[axis] = best - REACH
    return shift[0], shift[1]


@dataclass
class Colours:
    """What the colour images of a sequence show, frame by frame.

    Attributes:
        frames: Frames measured.
        own: float64 (2, 13) each, contrast of a picture at its own silhouette.
        others: Name of an explanation -> ratios, of the frames measured.
    """

    frames: list[int] = field(default_factory=list)
    own: list[FloatArray] = field(default_factory=list)
    others: dict[str, list[float]] = field(default_factory=dict)
    _last: tuple[int, Rgb, Silhouette] | None = None

    def add(self, frame: int, rgb: Rgb, seen: npt.NDArray[np.bool_]) -> None:
        """Measure a frame whose surface image fits its points."""
        silhouette = Silhouette.of(seen)
        contrast = silhouette.contrast(rgb)
        if not np.isfinite(recognised(contrast)):
            return
        self.frames.append(frame)
        self.own.append(contrast)
        if recognised(contrast) < SURE_RATIO:
            for name, turn in _TURNS:
                ratio = recognised(silhouette.contrast(turn(rgb)))
                self.others.setdefault(f"the pictures are {name}", []).append(ratio)
        if self._last is not None:
            before, picture, outline = self._last
            if before == frame - 1:
                self._compare(contrast, rgb, silhouette, picture, outline)
        self._last = (frame, rgb, silhouette)

    def _compare(
        self,
        contrast: FloatArray,
        rgb: Rgb,
        silhouette: Silhouette,
        picture: Rgb,
        outline: Silhouette,
    ) -> None:
        """Compare with the frame before: whose picture fits whose silhouette."""
        before = recognised(self.own[-2])
        if min(recognised(contrast), before) < SURE_RATIO:
            for name, ratio in (
                ("before", recognised(silhouette.contrast(picture))),
                ("after", recognised(outline.contrast(rgb))),
            ):
                text = f"a silhouette is that of the picture of the frame {name}"
                self.others.setdefault(text, []).append(ratio)

    def explain(self) -> tuple[bool, str] | None:
        """Return (certain, what is wrong with the pictures); None if nothing is."""
        if not self.own:
            return None
        with np.errstate(invalid="ignore"):
            scaled = [part / np.nanmean(part) for part in self.own if np.nanmean(part) > 0]
        if not scaled:
            return None
        pooled = np.array([_mean([part[axis] for part in scaled]) for axis in (0, 1)])
        shift = best_shift(pooled)
        if any(shift):
            return True, (
                f"the silhouettes are seen ({shift[0]:+d}, {shift[1]:+d}) px (u, v) from where the "
                "surface images have them: shifted pictures?"
            )
        ratios = np.array([recognised(part) for part in self.own])
        low = ratios < MIN_RATIO
        if np.mean(low) < 0.5 and not (low.any() and self._explained(ratios, low)):
            return None
        found = self._explained(ratios, low)
        if found is not None:
            return True, found
        return False, (
            f"in {np.count_nonzero(low)} of {low.size} frames the colour changes no more at the "
            f"silhouette than 5 px away (ratio {float(np.median(ratios)):.2f}): pictures of other "
            "frames, or an object that its background hides?"
        )

    def _explained(self, ratios: FloatArray, low: npt.NDArray[np.bool_]) -> str | None:
        for text, found in self.others.items():
            best = float(np.median(found))
            if best > SURE_RATIO and best > SURE_RATIO * float(np.median(ratios[low])):
                return f"{text} (contrast ratio {best:.1f}, as they are {np.median(ratios):.1f})"
        return None


def _mean(parts: list[FloatArray]) -> FloatArray:
    known = [part for part in parts if np.isfinite(part).all()]
    return np.mean(known, axis=0) if known else np.full(2 * REACH + 1, np.nan)


def is_blank(rgb: Rgb) -> bool:
    """Return whether a picture is one colour, up to two steps of each channel."""
    some = rgb[:: max(1, rgb.shape[0] // 16), :: max(1, rgb.shape[1] // 16)].astype(np.int16)
    if np.abs(some - some[0, 0]).max() > 2:
        return False  # a few pixels are enough to see that it is not
    return bool(np.ptp(rgb.reshape(-1, 3), axis=0).max() <= 2)
