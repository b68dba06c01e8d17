"""The colliders of CS 184's cloth project: self-contact within a hash cell, a plane and a sphere.

They are here to compare Pliant's own with the course's. In the course's self-contact a mass sees
the masses of its own hash cell alone, so that neighbours across a cell's wall are missed, and the
push is divided by the number of steps in a frame, so that a fast layer passes through. A mass that
entered an obstacle is moved back to its surface, and friction scales the whole move from its last
position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from pliant.generator.objects.cloth.simulator import Sheet
from pliant.generator.scene.scene_object import FloatArray

SURFACE_OFFSET_M = 1e-4
"""A mass stopped by a plane is left this far on its own side (the course's constant)."""


@dataclass(frozen=True)
class Sphere:
    """The course's sphere.

    Attributes:
        origin_m: Centre, metres.
        radius_m: Radius, metres.
        friction: 0 slides freely, 1 sticks to the last position.
    """

    origin_m: tuple[float, float, float]
    radius_m: float
    friction: float

    def collide(self, positions: FloatArray, previous: FloatArray, free: FloatArray) -> None:
        """Move masses inside the sphere to its surface."""
        collide_sphere(
            positions, previous, free, np.array(self.origin_m), self.radius_m, self.friction
        )


@dataclass(frozen=True)
class Plane:
    """The course's plane.

    Attributes:
        point_m: A point of it, metres.
        normal: Its unit normal; both sides are solid to what crosses it.
        friction: 0 slides freely, 1 sticks to the last position.
    """

    point_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    friction: float

    def collide(self, positions: FloatArray, previous: FloatArray, free: FloatArray) -> None:
        """Move masses that crossed the plane in this step back to their side."""
        collide_plane(
            positions, previous, free, np.array(self.point_m), np.array(self.normal), self.friction
        )


@njit(cache=True)
def collide_sphere(
    positions: FloatArray,
    previous: FloatArray,
    free: FloatArray,
    origin: FloatArray,
    radius_m: float,
    friction: float,
) -> None:
    """X' = x_prev + (1 - f) (tangent - x_prev), tangent the nearest point of the sphere."""
    for i in range(positions.shape[0]):
        if free[i] == 0.0:
            continue
        dx = positions[i, 0] - origin[0]
        dy = positions[i, 1] - origin[1]
        dz = positions[i, 2] - origin[2]
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        if distance >= radius_m or distance == 0.0:
            continue
        scale = radius_m / distance
        for c in range(3):
            tangent = origin[c] + scale * (positions[i, c] - origin[c])
            positions[i, c] = previous[i, c] + (1.0 - friction) * (tangent - previous[i, c])


@njit(cache=True)
def collide_plane(
    positions: FloatArray,
    previous: FloatArray,
    free: FloatArray,
    point: FloatArray,
    normal: FloatArray,
    friction: float,
) -> None:
    """X' = x_prev + (1 - f) (tangent ± offset - x_prev) for a mass that changed sides."""
    for i in range(positions.shape[0]):
        if free[i] == 0.0:
            continue
        now = 0.0
        before = 0.0
        for c in range(3):
            now += (positions[i, c] - point[c]) * normal[c]
            before += (previous[i, c] - point[c]) * normal[c]
        if (before >= 0.0) == (now >= 0.0):
            continue
        offset = SURFACE_OFFSET_M if before >= 0.0 else -SURFACE_OFFSET_M
        for c in range(3):
            target = positions[i, c] - now * normal[c] + offset * normal[c]
            positions[i, c] = previous[i, c] + (1.0 - friction) * (target - previous[i, c])


@dataclass(frozen=True)
class CellContact:
    """The course's self-contact.

    Attributes:
        sheet: The cloth; its size sets the cells.
        thickness_m: Masses are pushed until they are twice this apart.
    """

    sheet: Sheet
    thickness_m: float = 0.0095

    def collide(self, positions: FloatArray, previous: FloatArray, free: FloatArray) -> None:
        """Push apart masses of one cell that are closer than twice the thickness."""
        sheet = self.sheet
        across = 3.0 * sheet.width_m / sheet.columns
        down = 3.0 * sheet.height_m / sheet.rows
        cell_m = np.array([across, down, max(across, down)])
        collide_cs184(positions, free, cell_m, self.thickness_m, sheet.steps_per_frame)


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
