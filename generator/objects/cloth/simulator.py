"""The simulator: the state of a sheet and its step, in the order of CS 184's cloth project.

Each step adds up the forces, moves the masses (Verlet), lets the colliders correct them in their
order (the cloth itself, then the obstacles), and limits the stretch. `Simulator` knows no tiers and
no files.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from pliant.generator.compiled import compiled
from pliant.generator.objects.cloth.grid import flat_positions
from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.generator.objects.cloth.springs import add_spring_forces, build_springs
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


Collider = Callable[[FloatArray, FloatArray, FloatArray], None]
"""Corrects masses after they moved, the cloth itself or an obstacle: positions (float64 (N, 3),
changed in place), the positions before the step, and float64 (N,), 0 for masses that stay."""

_COURSE_GRID: Final = GridShape(50, 50)


@dataclass(frozen=True)
class Sheet:
    """The numbers of a cloth and of its simulation; the defaults are those of the CS 184 project.

    Attributes:
        grid: The masses.
        side_m: Length along u, metres; the masses have the same spacing along v.
        density: Mass per area, kg/m²; a point's mass is the area times it, over the points.
        ks: Stiffness of structural and shear springs, N/m.
        bending_ratio: Stiffness of bending springs over `ks`.
        damping_percent: Share of the motion lost per step, percent.
        steps_per_second: 1 / dt.
        steps_per_frame: Steps per frame.
        longest_step_m: No mass moves farther in a step; infinity for none.
    """

    grid: GridShape = _COURSE_GRID
    side_m: float = 1.0
    density: float = 150.0
    ks: float = 5000.0
    bending_ratio: float = 0.2
    damping_percent: float = 0.2
    steps_per_second: float = 2700.0
    steps_per_frame: int = 30
    longest_step_m: float = float("inf")

    @property
    def spacing_m(self) -> float:
        """Distance of neighbouring masses at rest."""
        return self.side_m / (self.grid.columns - 1)

    @property
    def mass_kg(self) -> float:
        """Mass of one point."""
        area_m2 = self.side_m * self.side_m * self.grid.proportion
        return area_m2 * self.density / self.grid.vertices


class Simulator:
    """A sheet in motion.

    Attributes:
        sheet: Its settings.
        positions: float64 (N, 3), metres.
        previous: float64 (N, 3), metres, one step ago.
        free: float64 (N,), 1 for a free mass and 0 for a pinned or held one.
        damping: Share of the motion lost per step.
        steps: Steps made so far.
    """

    def __init__(
        self,
        sheet: Sheet,
        positions: FloatArray,
        *,
        gravity: Sequence[float],
        colliders: Sequence[Collider] = (),
    ) -> None:
        """Start a sheet at rest.

        Args:
            sheet: Settings.
            positions: float64 (N, 3), metres, where it starts.
            gravity: Acceleration, m/s², three numbers.
            colliders: What corrects the masses after they moved, in this order.
        """
        self.sheet = sheet
        self.rest = flat_positions(sheet.grid, sheet.side_m)
        self.springs = build_springs(sheet.grid, sheet.side_m, sheet.ks, sheet.bending_ratio)
        self.positions = np.array(positions, dtype=np.float64)
        self.previous = self.positions.copy()
        self.forces = np.zeros_like(self.positions)
        self.gravity = np.array(gravity, dtype=np.float64)
        self.colliders = tuple(colliders)
        self.free = np.ones(len(self.positions))
        self.damping = sheet.damping_percent / 100.0
        self.steps = 0
        self._still = np.zeros(3)

    @property
    def dt_s(self) -> float:
        """Length of a step, seconds."""
        return 1.0 / self.sheet.steps_per_second

    def step(self, hand_m: FloatArray | None = None) -> None:
        """Advance by one step.

        Args:
            hand_m: float64 (3,), how far held masses move in this step, metres.
        """
        sheet, springs = self.sheet, self.springs
        add_spring_forces(self.positions, self.forces, springs.families, sheet.grid.columns)
        hand = self._still if hand_m is None else hand_m
        motion = Motion(self.gravity, sheet.mass_kg, self.damping, self.dt_s, sheet.longest_step_m)
        verlet_step(self.positions, self.previous, self.forces, self.free, hand, motion)
        for collider in self.colliders:
            collider(self.positions, self.previous, self.free)
        limit_stretch(self.positions, self.free, springs.a, springs.b, springs.rest_m)
        self.steps += 1

    def run(self, steps: int) -> None:
        """Advance by a number of steps with every held mass at rest."""
        for _ in range(steps):
            self.step()

    def speeds(self) -> FloatArray:
        """Return how fast each mass moves: float64 (N,), m/s."""
        return np.asarray(np.linalg.norm(self.positions - self.previous, axis=1) / self.dt_s)

    def place(self, positions: FloatArray) -> None:
        """Put the masses somewhere, at rest.

        Args:
            positions: float64 (N, 3), metres.
        """
        self.positions[:] = positions
        self.previous[:] = positions
