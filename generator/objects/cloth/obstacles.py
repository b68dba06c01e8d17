"""The table that a cloth lies on.

A mass that went under it is lifted to its surface, and its slip is shortened by at most friction
times the lift (Coulomb), so that a cloth at rest stays at rest and a pulled cloth slides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from numba import njit

from pliant.generator.scene.scene_object import FloatArray


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
