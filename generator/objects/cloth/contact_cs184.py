"""Self-collision as in CS 184: average the pushes from masses in one's own hash cell.

Kept for comparison with the course. A mass sees the masses of its own cell alone, so that
neighbours across a cell's wall are missed, and the push is divided by the number of steps in
a frame, so that a fast layer goes through. `contact_pbd` mends both.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]


@njit(cache=True)
def collide_cs184(
    positions: FloatArray,
    free: FloatArray,
    cell_m: FloatArray,
    thickness_m: float,
    steps_per_frame: int,
) -> None:
    """Push apart masses of one cell that are closer than twice the thickness.

    For each mass in turn, the correction is the mean over such neighbours of what would
    part the two to 2 x thickness, divided by `steps_per_frame`. Cells are taken from the
    positions before the first correction.

    Args:
        positions: float64 (N, 3), metres; changed in place.
        free: float64 (N,), 0 for a pinned or held mass, which is not pushed.
        cell_m: float64 (3,), edges of a hash cell, metres.
        thickness_m: The cloth's thickness, metres.
        steps_per_frame: Steps in a frame of the course's simulation.
    """
    count = positions.shape[0]
    buckets = 2 * count
    cell = np.empty((count, 3), np.int64)
    bucket = np.empty(count, np.int64)
    start = np.zeros(buckets + 1, np.int64)
    for i in range(count):
        for c in range(3):
            cell[i, c] = math.floor(positions[i, c] / cell_m[c])
        mixed = (cell[i, 0] * 73856093) ^ (cell[i, 1] * 19349663) ^ (cell[i, 2] * 83492791)
        bucket[i] = mixed % buckets
        start[bucket[i] + 1] += 1
    for k in range(buckets):
        start[k + 1] += start[k]
    members = np.empty(count, np.int64)
    filled = start[:-1].copy()
    for i in range(count):
        members[filled[bucket[i]]] = i
        filled[bucket[i]] += 1

    gap = 2.0 * thickness_m
    for i in range(count):
        if free[i] == 0.0:
            continue
        push_x = 0.0
        push_y = 0.0
        push_z = 0.0
        pushes = 0
        for q in range(start[bucket[i]], start[bucket[i] + 1]):
            j = members[q]
            if (
                j == i
                or cell[j, 0] != cell[i, 0]
                or cell[j, 1] != cell[i, 1]
                or cell[j, 2] != cell[i, 2]
            ):
                continue
            dx = positions[i, 0] - positions[j, 0]
            dy = positions[i, 1] - positions[j, 1]
            dz = positions[i, 2] - positions[j, 2]
            square = dx * dx + dy * dy + dz * dz
            if 0.0 < square < gap * gap:
                distance = math.sqrt(square)
                scale = (gap - distance) / distance
                push_x += scale * dx
                push_y += scale * dy
                push_z += scale * dz
                pushes += 1
        if pushes > 0:
            positions[i, 0] += push_x / pushes / steps_per_frame
            positions[i, 1] += push_y / pushes / steps_per_frame
            positions[i, 2] += push_z / pushes / steps_per_frame
