"""Crossings of a flat curve, lifted so that the upper strand clears the lower one.

Seen from above the curve stays exactly what the control points make it; only heights are
added. Where two stretches come nearer than a diameter in the plane, the upper one must be
higher by what is missing: for every pair of samples, (height apart)^2 + (distance in the
plane)^2 >= diameter^2. So no pair of samples is ever nearer than that in space.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pliant.generator.compiled import compiled
from pliant.generator.objects.rope.contact import NEIGHBOUR_DIAMETERS
from pliant.spec.arrays import BoolArray, FloatArray, IntArray

CLEARANCE: Final = 1.012
"""Distance aimed at, in diameters: room for the polyline between samples."""

RAMP_DIAMETERS: Final = 1.7
"""Arc length over which a strand climbs to a crossing, in diameters (less where crossings
follow each other closely)."""

HIGHEST_DIAMETERS: Final = 4.0
"""Curves that would pile up higher are rejected."""


@compiled
def _close_pairs(
    xy: FloatArray, crossing: FloatArray, upper: FloatArray, apart: int, reach: float, far: float
) -> tuple[int, IntArray, FloatArray]:
    """List (upper, lower, height needed) of the pairs nearer than `reach` in the plane.

    A pair belongs to the crossing nearest to it along both strands; the count is -1 if one has
    no crossing within `far` samples, which means that two strands are in each other.
    """
    n = xy.shape[0]
    pairs = np.empty((64 * n, 2), dtype=np.int64)
    need = np.empty(64 * n)
    count = 0
    step = math.sqrt((xy[1, 0] - xy[0, 0]) ** 2 + (xy[1, 1] - xy[0, 1]) ** 2)
    for i in range(n):
        j = i + apart
        while j < n:
            d2 = (xy[i, 0] - xy[j, 0]) ** 2 + (xy[i, 1] - xy[j, 1]) ** 2
            if d2 >= reach * reach:
                j += max(1, int((math.sqrt(d2) - reach) / step))
                continue
            best = np.inf
            which = -1
            for k in range(crossing.shape[0]):
                off = abs(crossing[k, 0] - i) + abs(crossing[k, 1] - j)
                if off < best:
                    best = off
                    which = k
            if which < 0 or best > far or count >= need.shape[0]:
                return -1, pairs, need
            late_over = upper[which] > 0
            pairs[count, 0] = j if late_over else i
            pairs[count, 1] = i if late_over else j
            need[count] = math.sqrt(reach * reach - d2)
            count += 1
            j += 1
    return count, pairs, need


@compiled
def _spread(z: FloatArray, half: int, out: FloatArray) -> None:
    """Take the highest value within `half` samples, then smooth twice over half as many.

    Both smoothings together reach no farther than the maximum did, so the result is nowhere
    below `z`.
    """
    n = z.shape[0]
    top = np.empty(n)
    for i in range(n):
        top[i] = z[max(0, i - half) : i + half + 1].max()
    box = half // 2
    for _ in range(2):
        for i in range(n):
            total = 0.0
            for j in range(i - box, i + box + 1):
                total += top[min(max(j, 0), n - 1)]
            out[i] = total / (2 * box + 1)
        top[:] = out


@compiled
def _settle(
    floor: FloatArray, pairs: IntArray, need: FloatArray, half: int, highest: float
) -> tuple[bool, FloatArray]:
    n = floor.shape[0]
    z = np.empty(n)
    wanted = np.empty(n)
    _spread(floor, half, z)
    for _ in range(60):
        wanted[:] = floor
        short = 0.0
        for k in range(pairs.shape[0]):
            i = pairs[k, 0]
            level = z[pairs[k, 1]] + need[k]
            short = max(short, level - z[i])
            wanted[i] = max(wanted[i], level)
        if short < 1e-9:
            return True, z
        _spread(wanted, half, z)
        if z.max() > highest:
            return False, z
    return False, z


def lift(
    xy: FloatArray,
    crossing: FloatArray,
    late_over: BoolArray,
    floor_m: FloatArray,
    diameter_m: float,
) -> FloatArray | None:
    """Return the height of every sample of a flat curve.

    Args:
        xy: float64 (n, 2), metres, equal steps.
        crossing: float64 (c, 5), its crossings (`plane_crossings`).
        late_over: bool (c,), True where the later passage is the upper one.
        floor_m: float64 (n,), least height of each sample, metres.
        diameter_m: Diameter of the rope, metres.

    Returns:
        float64 (n,), metres; None where two strands are in each other without crossing, or
        the crossings would pile up too high.
    """
    step = float(np.sqrt(((xy[1] - xy[0]) ** 2).sum()))
    apart = math.ceil(NEIGHBOUR_DIAMETERS * diameter_m / step)
    far = 5.0 * diameter_m / step
    count, pairs, need = _close_pairs(
        np.ascontiguousarray(xy),
        np.ascontiguousarray(crossing),
        late_over.astype(np.float64),
        apart,
        CLEARANCE * diameter_m,
        far,
    )
    if count < 0:
        return None
    passages = np.sort(crossing[:, :2].reshape(-1))
    gap = np.diff(passages).min() if len(passages) > 1 else np.inf
    ramp = min(RAMP_DIAMETERS * diameter_m / step, max(0.45 * gap, 0.7 * diameter_m / step))
    half = max(2, round(ramp))
    good, z = _settle(floor_m, pairs[:count], need[:count], half, HIGHEST_DIAMETERS * diameter_m)
    return z if good else None
