"""Where a line crosses itself, and what that means for pixels on top of each other.

A mask does not show which of two crossing strands is on top. Whoever knows it (from
shading or depth) says so by an `Overlap`: pixels on the body of the upper strand are then the
upper strand's, even where the middle of the lower one is nearer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray


@dataclass(frozen=True)
class Crossing:
    """A place where a line crosses itself.

    Attributes:
        first: Number of the point before the place on the first passage.
        second: The same on the second passage, larger.
        place_px: float64 (2,).
        ways: float64 (2, 2), unit vectors along the line on the first and the second passage.
    """

    first: int
    second: int
    place_px: FloatArray
    ways: FloatArray


@dataclass(frozen=True)
class Overlap:
    """Two stretches of a trace of which one covers the other; numbers of stations.

    Attributes:
        upper: The stretch on top.
        lower: The one below it.
        half_px: Half the rope's width.
    """

    upper: slice
    lower: slice
    half_px: float


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
    ways = np.stack([step[first], step[second]], axis=1)
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    places_px = start[first] + on_first[met, None] * step[first]
    return list(map(Crossing, first.tolist(), second.tolist(), places_px, ways))


def overlap(
    crossing: Crossing, *, first_is_upper: bool, half_px: float, spacing_px: float, stations: int
) -> Overlap:
    """Return the stretches of a trace around a crossing.

    Args:
        crossing: The crossing; its numbers are stations.
        first_is_upper: Whether the first passage is on top.
        half_px: Half the rope's width.
        spacing_px: Distance of neighbouring stations.
        stations: Number of stations.
    """
    sine = abs(float(_cross(crossing.ways[0], crossing.ways[1])))
    reach = math.ceil((half_px / max(sine, TRACING.crossing_least_sine) + half_px) / spacing_px)

    def stretch(station: int) -> slice:
        return slice(max(0, station - reach), min(stations, station + reach + 1))

    first, second = stretch(crossing.first), stretch(crossing.second)
    upper, lower = (first, second) if first_is_upper else (second, first)
    return Overlap(upper, lower, half_px)


def nearest_stations(gap_px: FloatArray, overlaps: tuple[Overlap, ...]) -> npt.NDArray[np.int64]:
    """Return the station that each place belongs to: the nearest, or the one that covers it.

    Args:
        gap_px: float64 (N, S), distances from N places to S stations.
        overlaps: What is known of the trace's crossings.

    Returns:
        int64 (N,).
    """
    station = gap_px.argmin(axis=1)
    for each in overlaps:
        above = gap_px[:, each.upper].argmin(axis=1) + each.upper.start
        on_upper = (
            np.take_along_axis(gap_px, above[:, None], axis=1)[:, 0]
            <= TRACING.crossing_body * each.half_px
        )
        on_lower = (station >= each.lower.start) & (station < each.lower.stop)
        station = np.where(on_upper & on_lower, above, station)
    return station


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
