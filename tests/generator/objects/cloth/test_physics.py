"""The motion of a sheet by its equations, its longest step and the table."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.generator.objects.cloth.grid import flat_positions
from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.generator.objects.cloth.simulator import Sheet, Simulator, collide_table

DOWN = (0.0, 0.0, -9.8)


REACH = ((0, 1, 1.0), (1, 0, 1.0), (1, 1, 1.0), (1, -1, 1.0), (0, 2, 0.2), (2, 0, 0.2))
"""Springs of a mass: rows up, columns to the left, stiffness over that of structural springs."""


def reference_step(x: np.ndarray, last: np.ndarray, sheet: Sheet, held: list[int]) -> np.ndarray:
    """Return a sheet's masses after a step, from the equations in plain NumPy, spring by spring."""
    rows, columns = sheet.grid
    place = [np.array(divmod(mass, columns)) / (columns - 1) for mass in range(rows * columns)]
    dt_s = 1.0 / sheet.steps_per_second
    springs = [
        (mass, mass - down * columns - along, share)
        for mass in range(rows * columns)
        for down, along, share in REACH
        if mass // columns >= down and 0 <= mass % columns - along < columns
    ]
    total = np.tile([0.0, 0.0, -9.8 * sheet.mass_kg], (rows * columns, 1))
    for i, j, share in springs:
        rest = np.linalg.norm(place[i] - place[j])
        length = np.linalg.norm(x[j] - x[i])
        pull = share * sheet.ks * (length - rest) * (x[j] - x[i]) / length
        total[i] += pull
        total[j] -= pull
    new = x + (1 - sheet.damping_percent / 100) * (x - last) + total / sheet.mass_kg * dt_s**2
    new[held] = x[held]
    for i, j, _ in springs:
        rest = np.linalg.norm(place[i] - place[j])
        offset = new[j] - new[i]
        extra = max(1.0 - 1.1 * rest / np.linalg.norm(offset), 0.0) * offset
        free_i, free_j = i not in held, j not in held
        if free_i or free_j:
            new[i] += extra * free_i / (free_i + free_j)
            new[j] -= extra * free_j / (free_i + free_j)
    return new


LIGHT = {"density": 30.0, "ks": 2000.0, "damping_percent": 1.0, "steps_per_second": 5400.0}


@pytest.mark.parametrize(("rows", "numbers"), [(4, {}), (6, {}), (9, {}), (6, LIGHT)])
def test_a_sheet_moves_as_the_equations_say(rows: int, numbers: dict[str, float]) -> None:
    """Of a level sheet held by two corners of one side, 1 m apart."""
    sheet = Sheet(GridShape(rows, 6), **numbers)  # type: ignore[arg-type]
    assert sheet.mass_kg == pytest.approx(sheet.density * (rows - 1) / 5 / (rows * 6))
    simulator = Simulator(sheet, flat_positions(sheet.grid, 1), gravity=DOWN)
    simulator.free[[0, 5]] = 0.0
    simulator.positions[14, 2] += 0.15  # too far for its springs: the limit has work to do
    x, last = simulator.positions.copy(), simulator.previous.copy()
    rest = simulator.springs.rest_m
    for _ in range(50):
        simulator.step()
        x, last = reference_step(x, last, simulator.sheet, [0, 5]), x
        ends = x[simulator.springs.a] - x[simulator.springs.b]
        assert (np.linalg.norm(ends, axis=1) / rest).max() < 1.22
    assert np.abs(simulator.positions - x).max() < 1e-11
    assert np.abs(x[:, 2]).max() > 0.05


def test_no_mass_moves_farther_than_the_longest_step() -> None:
    sheet = Sheet(GridShape(5, 5), damping_percent=0.0, longest_step_m=1e-3)
    simulator = Simulator(sheet, flat_positions(sheet.grid, 1), gravity=DOWN)
    simulator.previous[:, 2] += 0.5
    simulator.step()
    np.testing.assert_allclose(simulator.positions[:, 2], -1e-3)


@pytest.mark.parametrize(
    ("now", "expected"),
    [
        # 0.2 under the table: lifted, and of a slip of 1 at most 0.5 x 0.2 is taken back.
        ([0.6, 0.8, -0.2], [0.54, 0.72, 0.0]),
        # A slip shorter than that is taken back whole.
        ([0.05, 0.0, -0.2], [0.0, 0.0, 0.0]),
    ],
)
def test_table_by_hand(now: list[float], expected: list[float]) -> None:
    positions = np.array([now, now])
    collide_table(0.0, 0.5, positions, np.zeros((2, 3)), np.array([1.0, 0.0]))
    np.testing.assert_allclose(positions, [expected, now])  # a held mass is left alone
