"""Moving traces to the middle of the rope, at the full resolution of its mask.

A walk on a coarse mask wanders about the middle by a pixel or two, which makes some parts of a
trace longer than they are. Across a trace, the mask shows where the middle is, except at crossings
and next to other strands, where what it shows is wider than the rope. The shift d_i of station
x_i along its normal n_i minimises

    sum_i w_i (d_i - m_i)^2 + lambda sum_i |y_(i-1) - 2 y_i + y_(i+1)|^2,    y_i = x_i + d_i n_i,

with m_i the middle of the mask across the trace, and w_i 1 where it is as wide there as usual and
0 elsewhere. The second term carries the trace straight through crossings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.linalg import solveh_banded

from pliant.baselines.pixels import lies_on
from pliant.baselines.tracing.settings import TRACING
from pliant.baselines.tracing.tilt import Nadir
from pliant.spec.arrays import FloatArray, Mask

_SECOND_DIFFERENCE: Final = (1.0, -2.0, 1.0)


@dataclass(frozen=True)
class Centred:
    """K paths along the middle of a rope, S places each, not quite evenly spaced.

    Attributes:
        places_px: float64 (K, S, 2).
        normals: float64 (K, S, 2), unit vectors across the paths.
        widths_px: float64 (K, S), the mask's width across them.
        usual_px: The rope's width: the median of them.
    """

    places_px: FloatArray
    normals: FloatArray
    widths_px: FloatArray
    usual_px: float

    @property
    def usual(self) -> Mask:
        """Where the mask is as wide as usual: no crossing, no strand next to it, bool (K, S)."""
        relative = self.widths_px / self.usual_px
        return np.asarray(
            (relative > TRACING.usual_widths[0]) & (relative < TRACING.usual_widths[1])
        )


def centred(paths_px: Sequence[FloatArray], mask: Mask, half_px: float) -> Centred:
    """Return paths along a rope moved to its middle.

    Args:
        paths_px: float64 (N, 2) each, pixels of the mask.
        mask: bool (H, W), the rope.
        half_px: About half of the rope's width.
    """
    for _ in range(TRACING.centring_rounds):
        even_px = np.stack([evenly_spaced(path, TRACING.stations)[0] for path in paths_px])
        found = _moved(even_px, mask, half_px)
        paths_px = list(found.places_px)
    return found


def evenly_spaced(
    path_px: FloatArray, count: int, nadir: Nadir | None = None
) -> tuple[FloatArray, float]:
    """Return places at equal distances along a path, float64 (count, 2), and its length.

    Args:
        path_px: float64 (N, 2).
        count: How many places.
        nadir: If given, distances are those on the table, in pixels of its scale at the nadir.
    """
    step = np.linalg.norm(np.diff(path_px, axis=0), axis=1)
    if nadir is not None:
        step /= nadir.magnification((path_px[1:] + path_px[:-1]) / 2)
    passed = np.concatenate([[0.0], np.cumsum(step)])
    at = np.linspace(0, passed[-1], count)
    places = np.stack([np.interp(at, passed, path_px[:, axis]) for axis in (0, 1)], axis=1)
    return places, float(passed[-1])


def _moved(places_px: FloatArray, mask: Mask, half_px: float) -> Centred:
    normals = _normals(places_px)
    left, right = (_to_edge(places_px, way, mask, half_px) for way in (-normals, normals))
    widths = left + right
    usual_px = float(np.median(widths[widths > 0])) if widths.any() else 2 * half_px
    before = Centred(places_px, normals, widths, usual_px)
    weight = before.usual.astype(np.float64)
    shifts = np.stack(list(map(_shift, places_px, normals, weight, (right - left) / 2)))
    return replace(before, places_px=places_px + shifts[..., None] * normals)


def _normals(stations_px: FloatArray) -> FloatArray:
    way = np.gradient(stations_px, axis=1)
    way /= np.linalg.norm(way, axis=2, keepdims=True) + 1e-9
    return np.stack([-way[..., 1], way[..., 0]], axis=2)


def _to_edge(stations_px: FloatArray, way: FloatArray, mask: Mask, half_px: float) -> FloatArray:
    """Return how far the mask reaches from stations on one side, float64 (K, S); 0 off it."""
    steps = np.arange(
        TRACING.edge_step_px / 2, TRACING.across_reach * half_px, TRACING.edge_step_px
    )
    ahead = stations_px[:, :, None] + steps[:, None] * way[:, :, None]  # (K, S, T, 2)
    off = ~lies_on(ahead.reshape(-1, 2), mask).reshape(ahead.shape[:3])
    reached = np.where(off.any(axis=2), off.argmax(axis=2), len(steps))
    return np.asarray(reached * TRACING.edge_step_px)


def _shift(
    place: FloatArray, normal: FloatArray, weight: FloatArray, middle: FloatArray
) -> FloatArray:
    """Return the shifts along the normals of one trace, float64 (S,)."""
    count = len(place)
    bands = np.zeros((3, count))  # the upper bands of the system's matrix
    bands[2] = weight + TRACING.centring_least_weight
    known = weight * middle
    for axis in (0, 1):
        bend = np.diff(place[:, axis], n=2)
        for i, a in enumerate(_SECOND_DIFFERENCE):
            one = slice(i, count - 2 + i)
            known[one] -= TRACING.centring_stiffness * a * normal[one, axis] * bend
            for j in range(i, 3):
                other = slice(j, count - 2 + j)
                product = a * _SECOND_DIFFERENCE[j] * normal[one, axis] * normal[other, axis]
                bands[2 - (j - i), other] += TRACING.centring_stiffness * product
    return np.asarray(solveh_banded(bands, known))
