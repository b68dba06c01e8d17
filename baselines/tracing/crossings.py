"""Where a line crosses itself, and which of its strands is seen there.

A mask does not show which of two crossing strands is on top, nor where its edge is. Whoever knows
it (from shading or depth) says so by an `Overlap`. Of places near both strands it gives the log
odds o that the first one is seen, and with the distance g to the middle of the upper one, in half
widths of the rope, a place is the first one's where o + w (b - g) > 0 (w negative where the first
is the lower one).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import Float32Array, FloatArray


@dataclass(frozen=True)
class Crossing:
    """A place where a line crosses itself.

    Attributes:
        first: Number of the point before the place on the first passage.
        second: The same on the second passage, larger.
        place_px: float64 (2,).
        directions: float64 (2, 2), unit vectors along the line on the first and the second passage.
    """

    first: int
    second: int
    place_px: FloatArray
    directions: FloatArray


@dataclass(frozen=True)
class VisibleStrand:
    """Which of two crossing strands is seen in a square around their crossing.

    Attributes:
        place_px: float64 (2,), the middle of the square.
        direction: float64 (2,), unit vector along its x axis.
        reach_px: Half its side.
        square: float32 (side, side), log odds that the first strand is seen and not the second one.
    """

    place_px: FloatArray
    direction: FloatArray
    reach_px: float
    square: Float32Array

    @property
    def first_on_top(self) -> bool:
        """Whether it is the first strand that is seen in the middle."""
        side = len(self.square)
        middle = slice(side * 5 // 12, side * 7 // 12)
        return float(self.square[middle, middle].sum()) > 0

    def log_odds(self, uv_px: npt.NDArray[np.floating[Any]]) -> Float32Array:
        """Return the log odds that places (N, 2) show the first strand, float32 (N,)."""
        apart = uv_px - self.place_px
        aside = np.array([-self.direction[1], self.direction[0]])
        share = np.stack([apart @ aside, apart @ self.direction]) / self.reach_px
        pixel = (share + 1) / 2 * len(self.square) - 0.5
        return np.asarray(map_coordinates(self.square, pixel, order=1, mode="nearest"))


@dataclass(frozen=True)
class Overlap:
    """Two stretches of a trace that cross; numbers of stations.

    Attributes:
        first: The stretch that `seen` calls the first.
        second: The other one.
        half_px: Half the rope's width.
        seen: Which of them is seen, place by place.
    """

    first: slice
    second: slice
    half_px: float
    seen: VisibleStrand


def self_crossings(line_px: FloatArray, least_apart: int) -> list[Crossing]:
    """Return where a polyline crosses itself.

    Args:
        line_px: float64 (N, 2), not NaN.
        least_apart: Passages fewer points apart are wobbles, no crossings.
    """
    start, step = line_px[:-1], np.diff(line_px, axis=0)
    middle, reach = start + step / 2, np.linalg.norm(step, axis=1)
    apart = np.add.outer(reach, reach)
    near = np.abs(np.subtract.outer(middle[:, 0], middle[:, 0])) <= apart
    near &= np.abs(np.subtract.outer(middle[:, 1], middle[:, 1])) <= apart
    i, j = np.triu(near, least_apart + 1).nonzero()
    across, gap = _cross(step[i], step[j]), start[j] - start[i]
    with np.errstate(divide="ignore", invalid="ignore"):
        on_first, on_second = _cross(gap, step[j]) / across, _cross(gap, step[i]) / across
    met = (on_first >= 0) & (on_first < 1) & (on_second >= 0) & (on_second < 1)
    first, second = i[met], j[met]
    directions = np.stack([step[first], step[second]], axis=1)
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    places_px = start[first] + on_first[met, None] * step[first]
    return list(map(Crossing, first.tolist(), second.tolist(), places_px, directions))


def nearest_stations(
    gap_px: FloatArray, uv_px: npt.NDArray[np.floating[Any]], overlaps: tuple[Overlap, ...]
) -> npt.NDArray[np.int64]:
    """Return the station that each place belongs to: the nearest one of the strand seen there.

    Args:
        gap_px: float64 (N, S), distances from N places to S stations.
        uv_px: float (N, 2), the places.
        overlaps: What is known of the trace's crossings.

    Returns:
        int64 (N,).
    """
    station = gap_px.argmin(axis=1)
    places = np.arange(len(station))
    for each in overlaps:
        first, second = (
            gap_px[:, part].argmin(axis=1) + part.start for part in (each.first, each.second)
        )
        gaps = np.stack([gap_px[places, first], gap_px[places, second]]) / each.half_px
        doubtful = gaps.max(axis=0) < TRACING.crossing_near
        doubtful &= (station == first) | (station == second)
        if doubtful.any():
            log_odds = each.seen.log_odds(uv_px[doubtful])
            top, sign = (0, 1) if each.seen.first_on_top else (1, -1)
            on_top = TRACING.crossing_weight * (TRACING.crossing_body - gaps[top, doubtful])
            on_first = log_odds + sign * on_top > 0
            station[doubtful] = np.where(on_first, first[doubtful], second[doubtful])
    return station


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
