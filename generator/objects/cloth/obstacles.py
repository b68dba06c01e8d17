"""What a cloth can lie on: the course's plane and sphere, and the table of the tiers.

Plane and sphere follow the course: a mass that went in is taken back to the surface, and
friction scales the whole move from its last position. The table of the tiers is Coulomb's: a
mass is lifted to the surface and its slip is shortened by at most friction times the lift, so
that a cloth at rest stays at rest and a cloth pulled over the table slides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]

SURFACE_OFFSET_M = 1e-4
"""A mass stopped by a plane is left this far on its own side (the course's constant)."""


class Obstacle(Protocol):
    """Anything that corrects masses after they moved."""

    def collide(self, positions: FloatArray, previous: FloatArray, free: FloatArray) -> None:
        """Correct `positions` (float64 (N, 3)) in place; masses with `free` 0 stay."""


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


@dataclass(frozen=True)
class Table:
    """A horizontal table with Coulomb friction; z is up.

    Attributes:
        height_m: Lowest z of a mass, metres.
        friction: Coulomb's coefficient.
    """

    height_m: float
    friction: float

    def collide(self, positions: FloatArray, previous: FloatArray, free: FloatArray) -> None:
        """Lift masses onto the table."""
        collide_table(positions, previous, free, self.height_m, self.friction)


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


@njit(cache=True)
def collide_table(
    positions: FloatArray,
    previous: FloatArray,
    free: FloatArray,
    height_m: float,
    friction: float,
) -> None:
    """Lift masses under the table and shorten their slip by at most friction x lift."""
    for i in range(positions.shape[0]):
        lift = height_m - positions[i, 2]
        if lift <= 0.0 or free[i] == 0.0:
            continue
        positions[i, 2] = height_m
        slip_x = positions[i, 0] - previous[i, 0]
        slip_y = positions[i, 1] - previous[i, 1]
        slip = math.sqrt(slip_x * slip_x + slip_y * slip_y)
        if slip > 0.0:
            share = min(1.0, friction * lift / slip)
            positions[i, 0] -= slip_x * share
            positions[i, 1] -= slip_y * share
