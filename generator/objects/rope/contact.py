"""Where a rope comes near itself: crossings seen from above, and distances in space."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from pliant.generator.compiled import compiled
from pliant.spec.arrays import FloatArray

NEIGHBOUR_DIAMETERS: Final = 2.5
"""Two stretches of rope are neighbours, and may be nearer than a diameter, if less than this
many diameters of arc length are between them: a half turn of the tightest bend."""

STATIC_RULE: Final = 0.98
"""Least distance of two centre-line stretches of a sampled shape, in diameters."""


@compiled
def squared_distance(points: FloatArray, i: int, j: int) -> float:
    """Return the squared distance of two points of float64 (n, 3)."""
    d2 = 0.0
    for c in range(3):
        d2 += (points[j, c] - points[i, c]) ** 2
    return d2


@compiled
def segment_distance(points: FloatArray, a: int, b: int) -> tuple[float, float, float]:
    """Return the squared distance of segments (a, a+1) and (b, b+1), and where they are nearest.

    Args:
        points: float64 (n, 3), metres.
        a: First point of one segment.
        b: First point of the other.

    Returns:
        Squared distance, and the positions 0..1 on both.
    """
    aa = bb = ab = ar = br = 0.0
    for c in range(3):
        u = points[a + 1, c] - points[a, c]
        v = points[b + 1, c] - points[b, c]
        r = points[a, c] - points[b, c]
        aa += u * u
        bb += v * v
        ab += u * v
        ar += u * r
        br += v * r
    det = aa * bb - ab * ab
    s = 0.5
    if det > 1e-12 * aa * bb:
        s = min(max((ab * br - ar * bb) / det, 0.0), 1.0)
    t = (ab * s + br) / bb
    if t < 0.0:
        t = 0.0
        s = min(max(-ar / aa, 0.0), 1.0)
    elif t > 1.0:
        t = 1.0
        s = min(max((ab - ar) / aa, 0.0), 1.0)
    d2 = 0.0
    for c in range(3):
        u = points[a + 1, c] - points[a, c]
        v = points[b + 1, c] - points[b, c]
        d = points[a, c] + s * u - points[b, c] - t * v
        d2 += d * d
    return d2, s, t


@compiled
def nearest_stretches(points: FloatArray, length_m: float, diameter_m: float) -> float:
    """Return the least distance of two stretches of a centre line that are not neighbours.

    Args:
        points: float64 (n, 3), metres, equal steps.
        length_m: Length of the curve, metres.
        diameter_m: Diameter of the rope, metres.

    Returns:
        Metres; inf if the rope is too short to have any.
    """
    n = points.shape[0]
    apart = math.ceil(NEIGHBOUR_DIAMETERS * diameter_m / (length_m / (n - 1))) + 1
    best = np.inf
    longest = 0.0
    for i in range(n - 1):
        longest = max(longest, squared_distance(points, i, i + 1))
    longest = math.sqrt(longest)
    for a in range(n - 1):
        b = a + apart
        while b < n - 1:
            d = math.sqrt(squared_distance(points, a, b)) - 2.0 * longest
            if d >= best:
                # Too far for the next few segments as well.
                b += max(1, int((d - best) / longest))
                continue
            d2, _, _ = segment_distance(points, a, b)
            if d2 < best * best:
                best = math.sqrt(d2)
            b += 1
    return best


@compiled
def plane_crossings(points: FloatArray) -> FloatArray:
    """Return where a polyline crosses itself as seen from above.

    Args:
        points: float64 (n, 2 or 3), metres.

    Returns:
        float64 (c, 5): position (in points, with fraction) on the earlier and on the later
        stretch, x, y, and +1 where (earlier x later) points up, else -1. At most 256.
    """
    n = points.shape[0]
    found = np.empty((256, 5))
    count = 0
    longest = 0.0
    for i in range(n - 1):
        d = (points[i + 1, 0] - points[i, 0]) ** 2 + (points[i + 1, 1] - points[i, 1]) ** 2
        longest = max(longest, d)
    longest = math.sqrt(longest)
    for a in range(n - 1):
        ux = points[a + 1, 0] - points[a, 0]
        uy = points[a + 1, 1] - points[a, 1]
        b = a + 2
        while b < n - 1:
            rx = points[b, 0] - points[a, 0]
            ry = points[b, 1] - points[a, 1]
            d = math.sqrt(rx * rx + ry * ry)
            if d > 2.0 * longest:
                b += max(1, int(d / longest) - 2)
                continue
            vx = points[b + 1, 0] - points[b, 0]
            vy = points[b + 1, 1] - points[b, 1]
            det = ux * vy - uy * vx
            if det != 0.0:
                s = (rx * vy - ry * vx) / det
                t = (rx * uy - ry * ux) / det
                if 0.0 <= s < 1.0 and 0.0 <= t < 1.0 and count < 256:
                    found[count, 0] = a + s
                    found[count, 1] = b + t
                    found[count, 2] = points[a, 0] + s * ux
                    found[count, 3] = points[a, 1] + s * uy
                    found[count, 4] = 1.0 if det > 0 else -1.0
                    count += 1
            b += 1
    return found[:count]


def crossings(points: FloatArray) -> list[dict[str, Any]]:
    """Return the crossings of a centre line, in order of arc length of their first passage.

    Args:
        points: float64 (n, 3), metres, equal steps.

    Returns:
        JSON-able: `s_over` and `s_under`, arc length over length of the upper and of the lower
        strand, 0..1; `position_m`, the point on the table plane, then the height of the upper
        strand; `sign`, +1 where the upper strand must turn left (by less than half a turn) to run
        along the lower one, as seen from above, -1 to the right.
    """
    last = len(points) - 1
    order = np.arange(last + 1)
    out: list[dict[str, Any]] = []
    for early, late, x, y, sign in plane_crossings(points):
        z_early, z_late = np.interp([early, late], order, points[:, 2])
        over, under = (early, late) if z_early >= z_late else (late, early)
        out.append(
            {
                "s_over": float(over / last),
                "s_under": float(under / last),
                "position_m": [float(x), float(y), float(max(z_early, z_late))],
                "sign": int(sign if over == early else -sign),
            }
        )
    return sorted(out, key=lambda each: min(each["s_over"], each["s_under"]))
