"""Springs between point masses: structural, shear and bending, and the forces they exert.

After Berkeley's CS 184 cloth: a structural spring joins neighbours in a row or a column, a
shear spring diagonal neighbours, and a bending spring masses two apart. Hooke's law gives
F = k (|p_b - p_a| - rest) along the spring, with a bending spring at a fraction (0.2 in the
project) of the stiffness of the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pliant.generator.compiled import compiled
from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.spec.arrays import FloatArray


class Family(NamedTuple):
    """All springs of one kind and direction: they have one rest length and one stiffness.

    Attributes:
        rows: Steps down the grid from a spring's first mass to its second, >= 0.
        columns: Steps along the row, negative for a shear spring that leans back.
        rest_m: Rest length, metres.
        stiffness: Newtons per metre.
    """

    rows: int
    columns: int
    rest_m: float
    stiffness: float


@dataclass(frozen=True)
class Springs:
    """The springs of a sheet, as families for the forces and one by one for the limit.

    The list is ordered by a spring's later mass, and for each mass: structural (left, above),
    shear (above left, above right), bending (two to the left, two above). Numbers of
    masses are unsigned: of signed ones, compiled loops test whether they count from the end.

    Attributes:
        families: The six families.
        a: uint32 (S,), the later mass of each spring.
        b: uint32 (S,), the earlier mass.
        rest_m: float64 (S,), rest length, metres.
    """

    families: tuple[Family, ...]
    a: npt.NDArray[np.uint32]
    b: npt.NDArray[np.uint32]
    rest_m: FloatArray


def build_springs(grid: GridShape, side_m: float, ks: float, bending_ratio: float) -> Springs:
    """Join the point masses of a flat grid.

    Args:
        grid: The masses.
        side_m: Length along u, metres.
        ks: Stiffness of structural and shear springs, N/m.
        bending_ratio: Stiffness of a bending spring over `ks`.

    Returns:
        The springs.
    """
    bending = bending_ratio * ks
    rows, columns = grid
    spacing = side_m / (columns - 1)
    families = tuple(
        Family(row, column, math.hypot(row * spacing, column * spacing), stiffness)
        for stiffness, steps in (
            (ks, ((0, 1), (1, 0))),  # structural
            (ks, ((1, 1), (1, -1))),  # shear
            (bending, ((0, 2), (2, 0))),
        )
        for row, column in steps
    )
    # later - earlier mass is (rows, columns) of the family, for both shear directions
    ends = [
        (
            row * columns + column,
            (row - family.rows) * columns + column - family.columns,
            family.rest_m,
        )
        for row in range(rows)
        for column in range(columns)
        for family in families
        if row >= family.rows and 0 <= column - family.columns < columns
    ]
    a, b, rest_m = zip(*ends, strict=True)
    return Springs(families, np.array(a, np.uint32), np.array(b, np.uint32), np.array(rest_m))


@compiled
def add_spring_forces(
    positions: FloatArray, forces: FloatArray, families: tuple[Family, ...], columns: int
) -> None:
    """Add every spring's force to the masses at its two ends, one family after another.

    A family's forces are computed first and then added to the masses at either end: loops over
    one-dimensional arrays without a dependence from one spring to the next, which the compiler runs
    several at a time. What would join the end of a row to the next row gets no force.

    Args:
        positions: float64 (rows * columns, 3), metres.
        forces: float64 (rows * columns, 3), newtons; changed in place.
        families: All springs.
        columns: Masses in a row.
    """
    at = np.ascontiguousarray(positions.T)
    total, pulls = np.zeros_like(at), np.empty_like(at)
    x, y, z = at[0], at[1], at[2]
    pull_x, pull_y, pull_z = pulls[0], pulls[1], pulls[2]
    for family in families:
        along, rest_m, stiffness = family.columns, family.rest_m, family.stiffness
        apart = family.rows * columns + along
        count = at.shape[1] - apart
        other_x, other_y, other_z = x[apart:], y[apart:], z[apart:]
        for n in range(count):
            dx, dy, dz = other_x[n] - x[n], other_y[n] - y[n], other_z[n] - z[n]
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            # Two masses in one place: there is no direction to push them in.
            pull = stiffness * (length - rest_m) / length if length > 0.0 else 0.0
            pull_x[n], pull_y[n], pull_z[n] = pull * dx, pull * dy, pull * dz
        first_column = columns - along if along > 0 else 0
        for column in range(first_column, columns if along > 0 else -along):
            pulls[:, column::columns] = 0.0
        for c in range(3):
            pull_c, first, second = pulls[c], total[c], total[c, apart:]
            if family.rows == 0:
                for n in range(count):
                    first[n] += pull_c[n]
            for n in range(count):
                second[n] -= pull_c[n]
            if family.rows > 0:  # a mass first gets the force from the row before
                for n in range(count):
                    first[n] += pull_c[n]
    for n in range(forces.shape[0]):
        for c in range(3):
            forces[n, c] += total[c, n]
