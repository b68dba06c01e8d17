"""The parts of a step after the forces: motion, the table, and the stretch limit."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pliant.generator.compiled import compiled
from pliant.spec.arrays import FloatArray

STRETCH_LIMIT = 1.1
"""Longest a spring may be after a step, over its rest length (Provot 1995)."""


class Motion(NamedTuple):
    """What moves the free masses in addition to the springs.

    Attributes:
        gravity: float64 (3,), m/s².
        mass_kg: Mass of one point.
        damping: d, share of the motion lost per step, 0 to 1.
        dt_s: Length of a step, seconds.
        longest_m: No free mass moves farther than this in a step, metres; infinity for none.
            Contact is found at the end of a step, so a mass must not jump past another.
    """

    gravity: FloatArray
    mass_kg: float
    damping: float
    dt_s: float
    longest_m: float


@compiled
def verlet_step(
    positions: FloatArray,
    previous: FloatArray,
    forces: FloatArray,
    free: FloatArray,
    hand: FloatArray,
    motion: Motion,
) -> None:
    """Move every mass by x' = x + (1 - d) (x - x_prev) + (F / m + g) dt².

    A mass that is not free keeps to the hand: it moves by `hand`, which is zero for a pinned
    one. Forces are cleared for the next step.

    Args:
        positions: float64 (N, 3), metres; changed in place.
        previous: float64 (N, 3), metres, one step ago; changed in place.
        forces: float64 (N, 3), newtons, without gravity; zero afterwards.
        free: float64 (N,), 1 for a free mass and 0 for a pinned or held one.
        hand: float64 (3,), metres that held masses move in this step.
        motion: Mass, gravity, damping and length of the step.
    """
    keep = 1.0 - motion.damping
    dt2 = motion.dt_s * motion.dt_s
    longest_m = motion.longest_m
    gravity = motion.gravity  # in the loop, each look into the tuple would count a reference
    for i in range(positions.shape[0]):
        if free[i] > 0.0:
            square = 0.0
            for c in range(3):
                x = positions[i, c]
                acceleration = forces[i, c] / motion.mass_kg + gravity[c]
                step = keep * (x - previous[i, c]) + acceleration * dt2
                previous[i, c] = x
                positions[i, c] = x + step
                square += step * step
            if square > longest_m * longest_m:
                share = longest_m / np.sqrt(square)
                for c in range(3):
                    positions[i, c] = previous[i, c] + (positions[i, c] - previous[i, c]) * share
        else:
            for c in range(3):
                previous[i, c] = positions[i, c]
                positions[i, c] += hand[c]
        for c in range(3):
            forces[i, c] = 0.0


@compiled
def collide_table(
    height_m: float, friction: float, positions: FloatArray, previous: FloatArray, free: FloatArray
) -> None:
    """Collide masses with a horizontal table with Coulomb friction; z is up.

    A mass under it is lifted to its surface, and its slip is shortened by at most friction times
    the lift, so that a cloth at rest stays at rest and a pulled cloth slides.

    Args:
        height_m: Lowest z of a mass, metres.
        friction: Coulomb's coefficient.
        positions: float64 (N, 3), metres; changed in place.
        previous: float64 (N, 3), metres, one step ago.
        free: float64 (N,), 0 for a mass that stays.
    """
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


@compiled
def limit_stretch(
    positions: FloatArray,
    free: FloatArray,
    a: npt.NDArray[np.uint32],
    b: npt.NDArray[np.uint32],
    rest_m: FloatArray,
) -> None:
    """Shorten every spring that is longer than the limit, one after another.

    The correction is split evenly between the two ends; a pinned or held end stays and the
    other takes all of it.

    Args:
        positions: float64 (N, 3), metres; changed in place.
        free: float64 (N,), 1 for a free mass and 0 for a pinned or held one.
        a: uint32 (S,), as in `Springs`, and so the rest.
        b: uint32 (S,).
        rest_m: float64 (S,).
    """
    for s in range(a.shape[0]):
        i = a[s]
        j = b[s]
        square = 0.0
        for c in range(3):
            square += (positions[j, c] - positions[i, c]) ** 2
        longest = STRETCH_LIMIT * rest_m[s]
        if square <= longest * longest:
            continue
        movable = free[i] + free[j]
        if movable == 0.0:
            continue
        length = math.sqrt(square)
        share = (length - longest) / length / movable
        towards_j = share * free[i]
        towards_i = share * free[j]
        for c in range(3):
            off = positions[j, c] - positions[i, c]
            positions[i, c] += towards_j * off
            positions[j, c] -= towards_i * off
