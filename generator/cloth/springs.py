"""Springs between point masses: structural, shear and bending, and the forces they exert.

After Berkeley's CS 184 cloth: a structural spring joins neighbours in a row or a column, a
shear spring diagonal neighbours, and a bending spring masses two apart. Hooke's law gives
F = k (|p_b - p_a| - rest) along the spring, with a bending spring at a fraction (0.2 in the
course) of the stiffness of the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]

STRUCTURAL, SHEAR, BENDING = 0, 1, 2

COURSE_BENDING_RATIO = 0.2
"""Stiffness of a bending spring over that of the others in the course."""


@dataclass(frozen=True)
class Springs:
    """The springs of a sheet, in the order in which they are limited.

    Attributes:
        a: int32 (S,), vertex at one end.
        b: int32 (S,), vertex at the other end.
        rest_m: float64 (S,), rest length, metres.
        stiffness: float64 (S,), newtons per metre.
        kind: int8 (S,), STRUCTURAL, SHEAR or BENDING.
    """

    a: IntArray
    b: IntArray
    rest_m: FloatArray
    stiffness: FloatArray
    kind: npt.NDArray[np.int8]


def build_springs(
    positions: FloatArray,
    columns: int,
    rows: int,
    ks: float,
    bending_ratio: float = COURSE_BENDING_RATIO,
    enabled: tuple[bool, bool, bool] = (True, True, True),
) -> Springs:
    """Join the point masses of a grid.

    Springs are ordered by their later mass, and for each mass: structural (left, above),
    shear (above left, above right), bending (two to the left, two above). A kind that is
    switched off keeps its length limit, as in the course, and loses its force.

    Args:
        positions: float64 (rows * columns, 3), the sheet at rest, metres.
        columns: Masses in a row.
        rows: Masses in a column.
        ks: Stiffness of structural and shear springs, N/m.
        bending_ratio: Stiffness of a bending spring over `ks`.
        enabled: Whether structural, shear and bending springs pull.

    Returns:
        The springs, at rest in `positions`.
    """
    ends: list[tuple[int, int, int]] = []
    for row in range(rows):
        for column in range(columns):
            mass = row * columns + column
            if column > 0:
                ends.append((mass, mass - 1, STRUCTURAL))
            if row > 0:
                ends.append((mass, mass - columns, STRUCTURAL))
            if row > 0 and column > 0:
                ends.append((mass, mass - columns - 1, SHEAR))
            if row > 0 and column < columns - 1:
                ends.append((mass, mass - columns + 1, SHEAR))
            if column > 1:
                ends.append((mass, mass - 2, BENDING))
            if row > 1:
                ends.append((mass, mass - 2 * columns, BENDING))
    table = np.array(ends, dtype=np.int32)
    a, b, kind = (np.ascontiguousarray(table[:, i]) for i in range(3))
    by_kind = np.array([ks * enabled[0], ks * enabled[1], bending_ratio * ks * enabled[2]])
    return Springs(
        a=a,
        b=b,
        rest_m=np.linalg.norm(positions[a] - positions[b], axis=1),
        stiffness=by_kind[kind],
        kind=kind.astype(np.int8),
    )


@njit(cache=True)
def add_spring_forces(
    positions: FloatArray,
    forces: FloatArray,
    a: IntArray,
    b: IntArray,
    rest_m: FloatArray,
    stiffness: FloatArray,
) -> None:
    """Add every spring's force to the masses at its two ends.

    Args:
        positions: float64 (N, 3), metres.
        forces: float64 (N, 3), newtons; changed in place.
        a: int32 (S,), as in `Springs`, and so the rest.
        b: int32 (S,).
        rest_m: float64 (S,).
        stiffness: float64 (S,).
    """
    for s in range(a.shape[0]):
        i = a[s]
        j = b[s]
        dx = positions[j, 0] - positions[i, 0]
        dy = positions[j, 1] - positions[i, 1]
        dz = positions[j, 2] - positions[i, 2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        if length == 0.0:
            continue  # two masses in one place: no direction to push them in
        pull = stiffness[s] * (length - rest_m[s]) / length
        forces[i, 0] += pull * dx
        forces[i, 1] += pull * dy
        forces[i, 2] += pull * dz
        forces[j, 0] -= pull * dx
        forces[j, 1] -= pull * dy
        forces[j, 2] -= pull * dz
