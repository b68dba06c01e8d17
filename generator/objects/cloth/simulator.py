"""The simulator: the state of a sheet and its step, in the order of CS 184's cloth project.

Each step adds up the forces, moves the masses (Verlet), lets the colliders correct them in their
order (the cloth itself, then the obstacles), and limits the stretch. `Simulator` knows no tiers and
no files.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pliant.generator.objects.cloth.grid import flat_positions
from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.generator.objects.cloth.springs import add_spring_forces, build_springs
from pliant.generator.objects.cloth.step import Motion, limit_stretch, verlet_step
from pliant.spec.arrays import FloatArray

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
