"""A smooth curve through the particles of a simulated rope."""

from __future__ import annotations

import numpy as np
from numba import njit

from pliant.generator.scene.scene_object import FloatArray


@njit(cache=True)
def _through(points: FloatArray, floor: float, per_segment: int, out: FloatArray) -> None:
    n = points.shape[0]
    share = np.empty(n)
    control = np.empty((n + 2, 3))
    # Control points of the uniform cubic B-spline that passes through the particles, straight
    # at both ends: (c[i-1] + 4 c[i] + c[i+1]) / 6 = p[i], a tridiagonal system.
    for c in range(3):
        control[1, c] = points[0, c]
        control[n, c] = points[n - 1, c]
    share[0] = 0.0
    for i in range(1, n - 1):
        pivot = 4.0 - share[i - 1]
        share[i] = 1.0 / pivot
        for c in range(3):
            control[i + 1, c] = (6.0 * points[i, c] - control[i, c]) / pivot
    for i in range(n - 2, 0, -1):
        for c in range(3):
            control[i + 1, c] -= share[i] * control[i + 2, c]
    # A B-spline stays within its control points: none below the floor, no dip into the table.
    for i in range(1, n + 1):
        control[i, 2] = max(control[i, 2], floor)
    for c in range(3):
        control[0, c] = 2.0 * control[1, c] - control[2, c]
        control[n + 1, c] = 2.0 * control[n, c] - control[n - 1, c]
    for i in range(n - 1):
        for k in range(per_segment):
            t = k / per_segment
            u = 1.0 - t
            for c in range(3):
                out[i * per_segment + k, c] = (
                    u**3 * control[i, c]
                    + (3.0 * t**3 - 6.0 * t * t + 4.0) * control[i + 1, c]
                    + (3.0 * u**3 - 6.0 * u * u + 4.0) * control[i + 2, c]
                    + t**3 * control[i + 3, c]
                ) / 6.0
    for c in range(3):
        out[(n - 1) * per_segment, c] = points[n - 1, c]
    out[(n - 1) * per_segment, 2] = max(points[n - 1, 2], floor)


def smooth_curve(points: FloatArray, floor_m: float, per_segment: int = 24) -> FloatArray:
    """Return points on the natural cubic spline through equally spaced particles.

    Args:
        points: float64 (n, 3), n >= 3, metres.
        floor_m: Least height, metres. Where particles rise steeply from it the curve passes
            above them rather than dip below it in between.
        per_segment: Points per stretch between two particles.

    Returns:
        float64 ((n - 1) * per_segment + 1, 3), metres.
    """
    out = np.empty(((len(points) - 1) * per_segment + 1, 3))
    _through(np.ascontiguousarray(points), floor_m, per_segment, out)
    return out
