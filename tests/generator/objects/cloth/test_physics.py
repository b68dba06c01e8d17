"""What must hold whatever the numbers: energy, momentum, convergence, obstacles."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.generator.objects.cloth.contact_pbd import PairContact
from pliant.generator.objects.cloth.grid import flat_positions
from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.generator.objects.cloth.simulator import Sheet, Simulator
from pliant.generator.objects.cloth.step import collide_table

DOWN = (0.0, 0.0, -9.8)


REACH = ((0, 1, 1.0), (1, 0, 1.0), (1, 1, 1.0), (1, -1, 1.0), (0, 2, 0.2), (2, 0, 0.2))
"""Springs of a mass: rows up, columns to the left, stiffness over that of structural springs."""


def hanging(rows: int, columns: int) -> Simulator:
    """A level sheet held by two corners of one side, 1 m apart."""
    sheet = Sheet(GridShape(rows, columns))
    simulator = Simulator(sheet, flat_positions(sheet.grid, sheet.side_m), gravity=DOWN)
    simulator.free[[0, columns - 1]] = 0.0
    return simulator


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


@pytest.mark.parametrize("rows", [4, 6, 9])
def test_a_sheet_moves_as_the_equations_say(rows: int) -> None:
    simulator = hanging(rows, 6)
    assert simulator.sheet.mass_kg == pytest.approx(150 * (rows - 1) / 5 / (rows * 6))
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


def energy_of(simulator: Simulator) -> float:
    """Kinetic, elastic and gravitational energy together, joules."""
    sheet, springs = simulator.sheet, simulator.springs
    ends = simulator.positions[springs.a] - simulator.positions[springs.b]
    stretch = np.linalg.norm(ends, axis=1) - springs.rest_m
    bending = springs.rest_m > 1.5 * sheet.spacing_m
    stiffness = sheet.ks * np.where(bending, sheet.bending_ratio, 1.0)
    elastic = 0.5 * (stiffness * stretch**2).sum()
    kinetic = 0.5 * sheet.mass_kg * (simulator.speeds() ** 2).sum()
    height = -sheet.mass_kg * (simulator.positions @ simulator.gravity).sum()
    return float(elastic + kinetic + height)


def test_energy_does_not_grow_in_a_damped_hang() -> None:
    simulator = hanging(20, 20)
    measured = []
    for _ in range(300):
        simulator.run(10)
        measured.append(energy_of(simulator))
    energies = np.array(measured)
    lost = energies[0] - energies.min()
    assert lost > 100.0  # a square metre of 150 kg has come down
    # Verlet's energy flickers by the phase of its fastest springs; it must never rise.
    assert np.diff(energies).max() < 2e-4 * lost


@pytest.mark.parametrize(
    ("density", "apart_m"),
    [
        (30.0, 1e-7),  # springs alone carry the sheet: its rest does not know the step
        (150.0, 3e-4),  # the course's: the limit carries it too, by corrections of each step
    ],
)
def test_half_the_step_sags_to_the_same_place(density: float, apart_m: float) -> None:
    places = []
    for halving in (1, 2):
        sheet = Sheet(
            grid=GridShape(16, 16),
            density=density,
            steps_per_second=2700.0 * halving,
            damping_percent=100.0 * (1.0 - (1.0 - 0.01) ** (1.0 / halving)),
        )
        simulator = Simulator(sheet, flat_positions(sheet.grid, 1), gravity=DOWN)
        simulator.free[[0, 15, 240, 255]] = 0.0
        simulator.run(5000 * halving)
        assert simulator.speeds().max() < 1e-3
        springs = simulator.springs
        length = np.linalg.norm(
            simulator.positions[springs.a] - simulator.positions[springs.b], axis=1
        )
        assert (length / springs.rest_m).max() == pytest.approx(1.1, abs=1e-3) or density < 150
        places.append(simulator.positions)
    assert places[0][:, 2].min() < -0.05  # it sags
    assert np.abs(places[0] - places[1]).max() < apart_m


def test_springs_limit_and_contact_keep_the_momentum() -> None:
    rng = np.random.default_rng(1)
    sheet = Sheet(GridShape(14, 14), damping_percent=0.0)
    contact = PairContact.of(sheet, 1.0 / 13, friction=0.3)
    crumpled = flat_positions(sheet.grid, 0.6) + rng.normal(0.0, 0.03, (196, 3))
    simulator = Simulator(sheet, crumpled, gravity=(0.0, 0.0, 0.0), colliders=[contact.collide])
    simulator.previous -= rng.normal((3e-4, -1e-4, 2e-4), 1e-4, (196, 3))
    before = (simulator.positions - simulator.previous).sum(axis=0)
    middle = simulator.positions.mean(axis=0)
    simulator.run(50)
    assert np.abs(simulator.positions - crumpled).max() > 0.01
    after = (simulator.positions - simulator.previous).sum(axis=0)
    np.testing.assert_allclose(after, before, atol=1e-12)
    np.testing.assert_allclose(
        simulator.positions.mean(axis=0), middle + 50 * before / 196, atol=1e-12
    )


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
