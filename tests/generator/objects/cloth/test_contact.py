"""Position-based contact: pairs by hand, and a list that never misses one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pliant.generator.objects.cloth.contact_pbd import Layers, PairContact, Pairs, part_pairs


@pytest.mark.parametrize(
    ("now", "before", "free", "friction", "expected"),
    [
        # A pair nearer than 1 is parted evenly, a held mass stays and the other goes all the way.
        ("0,0,0 0.6,0,0", "0,0,0 0.6,0,0", (1, 1), 0.0, "-0.2,0,0 0.8,0,0"),
        ("0,0,0 0,0,0.5", "0,0,0 0,0,0.5", (0, 1), 0.0, "0,0,0 0,0,1"),
        ("0,0,0 0,0,0.5", "0,0,0 0,0,0.5", (0, 0), 0.0, "0,0,0 0,0,0.5"),
        # A pair that is far enough is left alone.
        ("0,0,0 1,0,0", "0,0.3,0 1,0,0", (1, 1), 1.0, "0,0,0 1,0,0"),
        # Depth 0.4; the first mass slid 0.3 along y. Coulomb with 0.5 takes 0.2 of it, by halves.
        ("0,0.3,0 0.6,0.3,0", "0,0,0 0.6,0.3,0", (1, 1), 0.5, "-0.2,0.2,0 0.8,0.4,0"),
        # With 1.0 it could take 0.4: the slip ends, and does not turn round.
        ("0,0.3,0 0.6,0.3,0", "0,0,0 0.6,0.3,0", (1, 1), 1.0, "-0.2,0.15,0 0.8,0.45,0"),
        # Both masses move alike along y: no slip, so no friction.
        ("0,0.3,0 0.6,0.3,0", "0,0,0 0.6,0,0", (1, 1), 1.0, "-0.2,0.3,0 0.8,0.3,0"),
    ],
)
def test_a_pair_by_hand(
    now: str, before: str, free: tuple[float, float], friction: float, expected: str
) -> None:
    def places(text: str) -> np.ndarray:
        return np.array([each.split(",") for each in text.split()], float)

    x = places(now)
    ends = np.array([0], np.int32), np.array([1], np.int32)
    pairs = Pairs(*ends, np.array([1.0]), np.array([friction]))
    part_pairs(x, places(before), np.array(free, float), pairs, 1)
    np.testing.assert_allclose(x, places(expected), atol=1e-15)


def contact_of(rest: np.ndarray) -> PairContact:
    return PairContact(rest, Layers(distance_m=0.1, friction=0.3, layer_m=0.29, margin_m=0.06))


def listed(contact: PairContact) -> dict[tuple[int, int], tuple[float, float]]:
    pairs = zip(*(column[: contact._count] for column in contact._pairs), strict=True)
    return {(min(i, j), max(i, j)): (target, friction) for i, j, target, friction in pairs}


@pytest.mark.parametrize("spread", [0.3, 1.0, 30.0])  # 30: a box too wide for its finest cells
def test_the_list_holds_every_near_pair_once(spread: float) -> None:
    points = np.random.default_rng(3).uniform(-spread, spread, (600, 3))
    points[:200] = points[200:400] + 0.05
    contact = contact_of(points)
    contact.collide(points.copy(), points.copy(), np.ones(600))
    found = listed(contact)
    assert len(found) == contact._count
    assert set(found) == cKDTree(points).query_pairs(0.16)


def test_targets_and_friction_follow_the_rest_distance() -> None:
    # Neighbours 0.08 apart at rest: 0.98 of that. 0.2 apart: the contact distance.
    rest = np.array([[0, 0, 0], [0.08, 0, 0], [0.2, 0, 0], [0.9, 0, 0]], dtype=float)
    points = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0], [0, 0, 0.05]], dtype=float)
    contact = contact_of(rest)
    contact._list_pairs(points)
    found = listed(contact)
    target_m, friction = found[0, 1]
    assert target_m == pytest.approx(0.0784)
    assert friction == 0.0
    assert found[0, 2] == (0.1, 0.0)
    assert found[0, 3] == (0.1, 0.3)


def test_no_pair_is_missed_while_the_list_is_old() -> None:
    rng = np.random.default_rng(7)
    x = rng.uniform(0.0, 1.0, (400, 3))
    velocity = rng.normal(0.0, 0.004, x.shape)
    # Touching pairs would be pushed: without free masses the contact only watches.
    contact = contact_of(rng.uniform(0.0, 9.0, x.shape))
    for _ in range(60):
        x = x + velocity
        contact.collide(x, x.copy(), np.zeros(400))
        near = cKDTree(x).query_pairs(0.1)
        assert near <= set(listed(contact))
    assert 3 < contact.rebuilds < 60
