"""Proportions given as ranges: each sequence draws its own, and all name the same points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.generator.objects.rope.body import rope_points
from pliant.generator.objects.rope.mesh import rope_mesh
from pliant.generator.objects.rope.sampler import draw_proportions
from pliant.generator.settings import RopeSettings
from pliant.spec.configuration import settings_from
from tests.generator.world import made, scene, small
from tests.known import known

RANGES = {
    "length_m": [1.15, 1.6],
    "radius_m": [0.008, 0.0135],
    "strands": [3, 6],
    "turns": [12, 28],
    "ball_strand_radii": 5.0,
}


def rope(**changes: object) -> RopeSettings:
    return settings_from(RopeSettings, {**RANGES, **changes}, "rope")


def test_draws_fill_the_ranges_and_change_nothing_else() -> None:
    settings = rope()
    ropes = [draw_proportions(settings, np.random.default_rng(seed)) for seed in range(200)]
    assert {each.strands for each in ropes} == {3, 4, 5, 6}
    assert {each.turns for each in ropes} == set(range(12, 29))
    for name, (low, high) in (("length_m", (1.15, 1.6)), ("radius_m", (0.008, 0.0135))):
        values = np.array([getattr(each, name) for each in ropes])
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high >= values.max() > high - 0.05 * (high - low)
    assert ropes[0].knot_diameters == settings.knot_diameters
    assert not ropes[0].drawn


@pytest.mark.parametrize("ball", [True, False])
def test_ropes_of_all_proportions_name_the_same_points(ball: bool) -> None:
    settings = rope(ball=ball)
    first, *others = [scene("rope", seed=4, index=index, rope=settings) for index in range(9)]
    assert len({each.info["strands"] for each in (first, *others)}) > 2
    for other in others:
        np.testing.assert_array_equal(first.points.material, other.points.material)
        np.testing.assert_array_equal(first.points.partners, other.points.partners)


@pytest.mark.parametrize("ring", [6, 8, 10, 16])
@pytest.mark.parametrize("strands", [3, 4, 5, 6])
def test_no_ray_from_the_centre_leaves_between_two_strands(strands: int, ring: int) -> None:
    settings = RopeSettings(strands=strands, ring=ring, turns=12, length_m=1.6)
    points = rope_points(settings, rope_mesh(settings), same_points=True)
    angles = points.material[~points.centreline, 1].reshape(2, -1, 8)
    step = 2 * np.pi / 8
    asked = (np.arange(8) + 0.25) * step  # of a station; of its mirror image, the negative
    for turned, sign in zip(angles, (1, -1), strict=True):
        off = turned - sign * asked
        np.testing.assert_allclose((off + np.pi) % (2 * np.pi), np.pi, atol=1e-6)


def test_a_point_is_on_the_outside_of_the_rope() -> None:
    sampled = scene("rope", seed=4, rope=rope())
    rest, tables = sampled.parts[0].rest, sampled.points
    mine = np.flatnonzero(~tables.centreline)[::7]
    share = known(tables.share)[mine, None]
    place = (1 - share) * rest[tables.vertex[mine]] + share * rest[known(tables.other)[mine]]
    np.testing.assert_allclose(
        np.arctan2(place[:, 2], place[:, 1]), tables.material[mine, 1], atol=2e-7
    )
    # No corner of a strand within a degree of the point's direction is farther out.
    for at in place:
        section = rest[np.abs(rest[:, 0] - at[0]) < 1e-9, 1:]
        turn = np.arctan2(section[:, 1], section[:, 0]) - np.arctan2(at[2], at[1])
        near = np.abs((turn + np.pi) % (2 * np.pi) - np.pi) < np.radians(1)
        reach = np.hypot(*section[near].T)
        assert (reach <= np.hypot(at[1], at[2]) * 1.03).all()


def test_a_dataset_of_drawn_ropes_is_exact_and_records_the_draws(tmp_path: Path) -> None:
    config = small(size=(320, 240), splits={"test": 4}, seed=3, rope=rope(ball=False))
    dataset = made(config, tmp_path / "ropes")
    drawn = [each.info["parameters"] for each in dataset.sequences]
    assert len({each["length_m"] for each in drawn}) == 4
    assert all(0.008 <= each["radius_m"] <= 0.0135 for each in drawn)
    assert len(dataset.queries("test")) > 200
