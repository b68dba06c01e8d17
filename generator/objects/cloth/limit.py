"""The stretch limit: no spring ends a step longer than 1.1 times its rest length."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]

COURSE_LIMIT = 1.1
"""Longest a spring may be after a step, over its rest length (Provot 1995; the course)."""


@njit(cache=True)
def limit_stretch(
    positions: FloatArray,
    free: FloatArray,
    a: IntArray,
    b: IntArray,
    rest_m: FloatArray,
    limit: float,
) -> None:
    """Shorten every spring that is too long, one after another.

    The correction is split evenly between the two ends; a pinned or held end stays and the
    other takes all of it.

    Args:
        positions: float64 (N, 3), metres; changed in place.
        free: float64 (N,), 1 for a free mass and 0 for a pinned or held one.
        a: int32 (S,), as in `Springs`, and so the rest.
        b: int32 (S,).
        rest_m: float64 (S,).
        limit: Longest allowed length over the rest length.
    """
    for s in range(a.shape[0]):
        i = a[s]
        j = b[s]
        dx = positions[j, 0] - positions[i, 0]
        dy = positions[j, 1] - positions[i, 1]
        dz = positions[j, 2] - positions[i, 2]
        square = dx * dx + dy * dy + dz * dz
        longest = limit * rest_m[s]
        if square <= longest * longest:
            continue
        movable = free[i] + free[j]
        if movable == 0.0:
            continue
        length = math.sqrt(square)
        share = (length - longest) / length / movable
        towards_j = share * free[i]
        towards_i = share * free[j]
        positions[i, 0] += towards_j * dx
        positions[i, 1] += towards_j * dy
        positions[i, 2] += towards_j * dz
        positions[j, 0] -= towards_i * dx
        positions[j, 1] -= towards_i * dy
        positions[j, 2] -= towards_i * dz
