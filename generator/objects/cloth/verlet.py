"""The integrator: Verlet's step with the course's damping, and masses led by a hand."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]


@njit(cache=True)
def verlet_step(
    positions: FloatArray,
    previous: FloatArray,
    forces: FloatArray,
    free: FloatArray,
    gravity: FloatArray,
    hand: FloatArray,
    mass_kg: float,
    damping: float,
    dt_s: float,
    longest_m: float,
) -> None:
    """Move every mass by x' = x + (1 - d) (x - x_prev) + (F / m + g) dt².

    A mass that is not free keeps to the hand: it moves by `hand`, which is zero for a pinned
    one. Forces are cleared for the next step.

    Args:
        positions: float64 (N, 3), metres; changed in place.
        previous: float64 (N, 3), metres, one step ago; changed in place.
        forces: float64 (N, 3), newtons, without gravity; zero afterwards.
        free: float64 (N,), 1 for a free mass and 0 for a pinned or held one.
        gravity: float64 (3,), m/s².
        hand: float64 (3,), metres that held masses move in this step.
        mass_kg: Mass of one point.
        damping: d, share of the motion lost per step, 0 to 1.
        dt_s: Length of a step, seconds.
        longest_m: No free mass moves farther than this in a step, metres; infinity for none.
            Contact is found at the end of a step, so a mass must not jump past another.
    """
    keep = 1.0 - damping
    dt2 = dt_s * dt_s
    for i in range(positions.shape[0]):
        if free[i] > 0.0:
            square = 0.0
            for c in range(3):
                x = positions[i, c]
                acceleration = forces[i, c] / mass_kg + gravity[c]
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
