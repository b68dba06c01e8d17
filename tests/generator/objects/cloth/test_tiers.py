"""The tiers as the renderer takes them: coverage, calm, no crossing, exact points."""

from __future__ import annotations

import json
from typing import get_args

import numpy as np
import pytest

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.cloth.measure import shows_underside
from pliant.generator.objects.tiers import describe_tier
from pliant.generator.scene.scene_object import Pose, SceneObject
from pliant.generator.settings.cloth import COVERAGE_BANDS, ClothSettings, Variant
from pliant.spec.errors import GenerationError
from tests.generator.objects.cloth.test_surface import count_intersections
from tests.generator.world import scene

COARSE = ClothSettings(points_a_side=33)


def crossings(pose: Pose, scene_object: SceneObject) -> int:
    faces = scene_object.parts[0].faces
    return count_intersections(pose.vertices["cloth"], faces)


@pytest.mark.parametrize(
    ("level", "speed_m_s", "proportion"),
    [
        (1, 3.0, 1.0),
        (2, 0.6, 1.0),
        (3, 0.6, 1.0),
        (1, 0.6, 0.5),
        (2, 0.6, 1.6),
        (3, 0.6, 0.7),
        pytest.param(1, 0.6, 1.0, marks=pytest.mark.long),
        pytest.param(2, 3.0, 1.0, marks=pytest.mark.long),
        pytest.param(3, 3.0, 1.0, marks=pytest.mark.long),
    ],
)
def test_a_tier_keeps_its_word(level: int, speed_m_s: float, proportion: float) -> None:
    settings = COARSE.replace(hand_speed_m_s=speed_m_s, proportion=proportion, tracked_a_side=17)
    scene_object = scene(f"cloth-{level}", frames=3, cloth=settings)
    low, high = COVERAGE_BANDS[level]
    for frame in range(3 if speed_m_s < 1 and proportion == 1 else 2):
        pose = scene_object.pose(frame)
        vertices, info = pose.vertices["cloth"], pose.info
        assert np.isfinite(vertices).all()
        assert low <= info["coverage"] <= high
        assert info["coverage"] <= info["coverage_hull"] + 0.005
        # What the silhouette lacks is hidden, stretched or slanting; at least a part is hidden.
        assert 0.0 < info["self_occluded_area"] < 1.0
        assert info["mean_speed_m_s"] < 1e-3
        assert set(info["hidden_corners"]) <= {0, 1, 2, 3}
        assert info["tries"] == 1 + sum(info["refused"].values())
        assert vertices[:, 2].min() >= 0.5 * settings.thickness_m - 1e-12
        middle = (vertices.max(axis=0) + vertices.min(axis=0)) / 2
        assert np.abs(middle[:2]).max() < 0.02
        assert crossings(pose, scene_object) == 0
        hands = [action for action in info["actions"] if action["name"] != "stand"]
        assert hands
        assert all(action["speed_m_s"] == speed_m_s for action in hands)
        assert all(0 <= m <= 1 for action in hands for m in action["picked"])
        assert json.loads(json.dumps(info)) == info


def test_the_material_is_hardly_stretched() -> None:
    vertices = scene("cloth-3", cloth=COARSE).pose(0).vertices["cloth"].reshape(65, 65, 3)
    cell_m = 0.6 / 64
    for axis in (0, 1):
        length = np.linalg.norm(np.diff(vertices, axis=axis), axis=2) / cell_m
        assert np.quantile(length, 0.99) < 1.12
        assert np.median(length) > 0.85


def test_a_band_that_cannot_be_met_is_an_error_that_says_so() -> None:
    settings = ClothSettings(
        points_a_side=17, tracked_a_side=17, coverage_band=(1.1, 1.2), max_tries=2
    )
    with pytest.raises(GenerationError, match=r"coverage_band.*2 x coverage outside the band"):
        scene("cloth-1", cloth=settings).pose(0)


@pytest.mark.parametrize("variant", get_args(Variant))
def test_points_and_partners_are_exact(variant: Variant) -> None:
    settings = ClothSettings(variant=variant)
    scene_object = scene("cloth-2", cloth=settings)
    tier = describe_tier(GenerateConfig(tiers=("cloth-2",), cloth=settings), "cloth-2")
    points, part = scene_object.points, scene_object.parts[0]
    assert (tier.variant, scene_object.variant) == (variant, settings.pattern)
    assert len(points.vertex) == 33 * 33
    assert part.double_sided
    np.testing.assert_array_equal(part.chart(part.rest[points.vertex]), points.material)
    expected = {"plain": 7, "towel": 0, "printed": 0}
    assert len(tier.symmetries) == expected[variant]
    assert points.partners.shape == (33 * 33, expected[variant])
    seen = {tuple(range(33 * 33))}
    for column, symmetry in enumerate(tier.symmetries):
        partner = points.partners[:, column]
        assert sorted(partner) == list(range(33 * 33))
        mapped = points.material @ np.array(symmetry.matrix, np.float32).T
        mapped += np.array(symmetry.offset, np.float32)
        np.testing.assert_array_equal(points.material[partner], mapped)
        seen.add(tuple(partner))
    assert len(seen) == expected[variant] + 1  # all different, none the identity


def test_faces_are_the_whole_sheet_facing_up() -> None:
    part = scene("cloth-1").parts[0]
    a, b, c = (part.rest[part.faces[:, k]] for k in range(3))
    area = 0.5 * np.cross(b - a, c - a)
    assert (area[:, 2] > 0).all()
    assert area[:, 2].sum() == pytest.approx(1.0)


def test_alternate_sequences_show_either_side() -> None:
    settings = ClothSettings(
        points_a_side=25, tracked_a_side=25, sides="alternate", max_tries=200
    )  # fmt: skip
    flat = scene("cloth-1").parts[0]
    assert not shows_underside(flat.rest, flat.faces)
    assert shows_underside(flat.rest * [1, -1, 1], flat.faces)
    for index in range(2):
        scene_object = scene("cloth-2", index=index, seed=3, cloth=settings)
        pose = scene_object.pose(0)
        found = shows_underside(pose.vertices["cloth"], scene_object.parts[0].faces)
        assert found == (index % 2 == 1)
        assert pose.info["tries"] == 1 + sum(pose.info["refused"].values())
