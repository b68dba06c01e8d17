"""What must hold whatever the numbers: energy, momentum, convergence, obstacles."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.course_cloth import CellContact, Plane, Sphere
from pliant.generator.objects.cloth.contact_pbd import PairContact
from pliant.generator.objects.cloth.grid import flat_positions
from pliant.generator.objects.cloth.simulator import Sheet, Simulator
from pliant.generator.objects.cloth.springs import BENDING, SHEAR, STRUCTURAL, build_springs
from pliant.generator.objects.cloth.step import Table

DOWN = (0.0, 0.0, -9.8)


def hanging(points: int, **changes: object) -> Simulator:
    """A level sheet held by two corners of one side."""
    sheet = dataclasses.replace(Sheet(columns=points, rows=points), **changes)  # type: ignore[arg-type]
    pinned = np.zeros(points * points, dtype=bool)
    pinned[[0, points - 1]] = True
    start = flat_positions(points, points, sheet.width_m, sheet.height_m)
    return Simulator(sheet, start, gravity=DOWN, pinned=pinned)


def test_springs_of_a_small_grid() -> None:
    springs = build_springs(3, 2, 2.0, 1.0, 100.0, 0.2)
    found = {
        (int(a), int(b)): (springs.families[f].kind, round(float(r), 12), float(k))
        for a, b, f, r, k in zip(
            springs.a, springs.b, springs.family, springs.rest_m, springs.stiffness, strict=True
        )
    }
    diagonal = round(2.0**0.5, 12)
    assert found == {
        (1, 0): (STRUCTURAL, 1.0, 100.0),
        (2, 1): (STRUCTURAL, 1.0, 100.0),
        (2, 0): (BENDING, 2.0, 20.0),
        (3, 0): (STRUCTURAL, 1.0, 100.0),
        (3, 1): (SHEAR, diagonal, 100.0),
        (4, 3): (STRUCTURAL, 1.0, 100.0),
        (4, 1): (STRUCTURAL, 1.0, 100.0),
        (4, 0): (SHEAR, diagonal, 100.0),
        (4, 2): (SHEAR, diagonal, 100.0),
        (5, 4): (STRUCTURAL, 1.0, 100.0),
        (5, 2): (STRUCTURAL, 1.0, 100.0),
        (5, 1): (SHEAR, diagonal, 100.0),
        (5, 3): (BENDING, 2.0, 20.0),
    }


def energy_of(simulator: Simulator) -> float:
    """Kinetic, elastic and gravitational energy together, joules."""
    sheet, springs = simulator.sheet, simulator.springs
    ends = simulator.positions[springs.a] - simulator.positions[springs.b]
    stretch = np.linalg.norm(ends, axis=1) - springs.rest_m
    elastic = 0.5 * (springs.stiffness * stretch**2).sum()
    kinetic = 0.5 * sheet.mass_kg * (simulator.speeds() ** 2).sum()
    height = -sheet.mass_kg * (simulator.positions @ simulator.gravity).sum()
    return float(elastic + kinetic + height)


def test_energy_does_not_grow_in_a_damped_hang() -> None:
    simulator = hanging(20)
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
            columns=16,
            rows=16,
            density=density,
            steps_per_second=2700.0 * halving,
            damping_percent=100.0 * (1.0 - (1.0 - 0.01) ** (1.0 / halving)),
        )
        pinned = np.zeros(256, dtype=bool)
        pinned[[0, 15, 240, 255]] = True
        simulator = Simulator(sheet, flat_positions(16, 16, 1, 1), gravity=DOWN, pinned=pinned)
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
    sheet = Sheet(columns=14, rows=14, damping_percent=0.0)
    contact = PairContact.of(sheet, 1.0 / 13, friction=0.3)
    crumpled = flat_positions(14, 14, 0.6, 0.6) + rng.normal(0.0, 0.03, (196, 3))
    simulator = Simulator(sheet, crumpled, gravity=(0.0, 0.0, 0.0), colliders=[contact])
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


def test_pinned_masses_stay_and_springs_end_within_the_limit() -> None:
    simulator = hanging(20)
    start = simulator.positions[[0, 19]].copy()
    simulator.run(1500)
    np.testing.assert_array_equal(simulator.positions[[0, 19]], start)
    springs = simulator.springs
    length = np.linalg.norm(simulator.positions[springs.a] - simulator.positions[springs.b], axis=1)
    # One pass in order: a later spring may lengthen an earlier one a little.
    assert (length / springs.rest_m).max() < 1.15
    assert np.quantile(length / springs.rest_m, 0.99) < 1.101


def test_a_free_mass_falls_as_verlet_says() -> None:
    sheet = Sheet(columns=3, rows=3, damping_percent=10.0)
    simulator = Simulator(sheet, flat_positions(3, 3, 1, 1), gravity=DOWN)
    simulator.run(3)
    g = 9.8 / 2700.0**2
    # steps: g, then 0.9 g + g, then 0.9 (1.9 g) + g
    np.testing.assert_allclose(simulator.positions[:, 2], -(1.0 + 1.9 + 2.71) * g, rtol=1e-12)


def test_no_mass_moves_farther_than_the_longest_step() -> None:
    sheet = Sheet(columns=5, rows=5, damping_percent=0.0, longest_step_m=1e-3)
    simulator = Simulator(sheet, flat_positions(5, 5, 1, 1), gravity=DOWN)
    simulator.previous[:, 2] += 0.5
    simulator.step()
    np.testing.assert_allclose(simulator.positions[:, 2], -1e-3)


def one_mass(obstacle: Plane | Sphere | Table, last: list[float], now: list[float]) -> np.ndarray:
    positions, previous = np.array([now]), np.array([last])
    obstacle.collide(positions, previous, np.ones(1))
    held = np.array([now])
    obstacle.collide(held, previous, np.zeros(1))
    np.testing.assert_array_equal(held, [now])  # a held mass is left alone
    return positions[0]


def test_plane_by_hand() -> None:
    plane = Plane((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), friction=0.25)
    # From y = 1.2 to 0.8 while x goes 1: the tangent point is (1, 1, 0), raised by 1e-4.
    found = one_mass(plane, [0.0, 1.2, 0.0], [1.0, 0.8, 0.0])
    np.testing.assert_allclose(found, [0.75, 1.2 + 0.75 * (1.0001 - 1.2), 0.0])
    # From below, it stays below.
    found = one_mass(plane, [0.0, 0.9, 0.0], [0.0, 1.1, 0.0])
    np.testing.assert_allclose(found, [0.0, 0.9 + 0.75 * (0.9999 - 0.9), 0.0])
    np.testing.assert_array_equal(one_mass(plane, [0, 2.0, 0], [0, 1.5, 0]), [0, 1.5, 0])


def test_sphere_by_hand() -> None:
    sphere = Sphere((0.0, 0.0, 0.0), 2.0, friction=0.5)
    # At (1, 0, 0) inside: the nearest point of the sphere is (2, 0, 0).
    found = one_mass(sphere, [3.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    np.testing.assert_allclose(found, [2.5, 0.5, 0.0])
    np.testing.assert_array_equal(one_mass(sphere, [3, 0, 0], [2.5, 0, 0]), [2.5, 0, 0])


def test_table_by_hand() -> None:
    table = Table(0.0, friction=0.5)
    # 0.2 under the table: lifted, and of a slip of 1 at most 0.5 x 0.2 is taken back.
    np.testing.assert_allclose(one_mass(table, [0, 0, 0], [0.6, 0.8, -0.2]), [0.54, 0.72, 0.0])
    # A slip shorter than that is taken back whole.
    np.testing.assert_allclose(one_mass(table, [0, 0, 0], [0.05, 0.0, -0.2]), [0.0, 0.0, 0.0])


@pytest.mark.parametrize("contact", ["cs184", "pbd"])
def test_a_cloth_comes_to_rest_on_the_sphere_and_not_in_it(contact: str) -> None:
    sheet = Sheet(columns=20, rows=20)
    own = CellContact(sheet) if contact == "cs184" else PairContact.of(sheet, 0.04)
    start = np.add(flat_positions(20, 20, 1, 1), [-0.5, -0.5, 0.35])
    ball = Sphere((0.0, 0.0, 0.0), 0.3, friction=0.5)
    simulator = Simulator(sheet, start, gravity=DOWN, colliders=[own, ball])
    simulator.run(1500)
    distance = np.linalg.norm(simulator.positions, axis=1)
    assert distance.min() > 0.29
    assert (distance < 0.31).sum() > 20
