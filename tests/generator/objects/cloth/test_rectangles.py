"""Cloths that are not square, towels and prints: lengths, symmetries, patterns, whole datasets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.tiers import describe_tier
from pliant.generator.rendering.materials import cloth_images
from pliant.generator.scene.appearance import sample_appearance
from pliant.generator.scene.scene_object import SceneObject
from pliant.generator.settings import AppearanceSettings, ClothSettings
from pliant.spec.arrays import Float32Array
from pliant.spec.model import SQUARE_MIRRORS, SQUARE_ROTATIONS, Symmetry, Tier
from tests.generator.world import made, scene, small

LENGTHS_M = {0.5: (0.6, 0.3), 0.7: (0.6, 0.4125), 1.0: (0.6, 0.6), 1.6: (0.6, 0.975)}
"""Proportion -> lengths along u and v: of 32 cells along u, and 16, 22, 32 or 52 along v."""

TRACKED = {0.5: (17, 9), 0.7: (17, 12), 1.0: (17, 17), 1.6: (17, 27)}
"""Proportion -> tracked points along u and v: every fourth vertex of the rendered grid."""


def coarse(proportion: float) -> ClothSettings:
    return ClothSettings(points_a_side=33, tracked_a_side=17, proportion=proportion)


def flat_cloth(proportion: float, tier: str = "cloth-1") -> tuple[SceneObject, Tier, np.ndarray]:
    """Return a cloth, its tier and the places of its points (P, 3) while it is flat: metres."""
    settings = coarse(proportion).replace(level=1)
    cloth = scene(tier, frames=2, episodes=True, cloth=settings)
    described = describe_tier(GenerateConfig(tiers=(tier,), cloth=settings), tier)
    return cloth, described, cloth.pose(0).vertices["cloth"][cloth.points.vertex]


@pytest.mark.parametrize("tier", ["cloth-1", "towel"])
@pytest.mark.parametrize("proportion", LENGTHS_M)
def test_distances_on_a_flat_cloth_are_the_lengths_of_the_tier(
    proportion: float, tier: str
) -> None:
    cloth, described, places = flat_cloth(proportion, tier)
    lengths = [each.metres_per_unit for each in described.queried.material]
    assert lengths == pytest.approx(LENGTHS_M[proportion])
    along = np.array(LENGTHS_M[proportion]) * cloth.points.material
    one, two = np.random.default_rng(0).integers(0, len(places), (2, 500))
    expected = np.linalg.norm(along[one] - along[two], axis=1)
    np.testing.assert_allclose(
        np.linalg.norm(places[one] - places[two], axis=1), expected, atol=1e-6
    )
    # A step of the tracked points is as long along v as along u.
    steps = [np.diff(np.unique(along[:, axis].round(6))) for axis in (0, 1)]
    assert (len(steps[0]) + 1, len(steps[1]) + 1) == TRACKED[proportion]
    np.testing.assert_allclose(np.concatenate(steps), 0.6 / 16, atol=2e-6)


@pytest.mark.parametrize("proportion", [0.5, 0.7, 1.6])
def test_the_symmetries_are_those_that_keep_every_distance(proportion: float) -> None:
    cloth, described, places = flat_cloth(proportion)
    names = [each.name for each in described.symmetries]
    assert names == ["rotation_180", "mirror_u", "mirror_v"]
    count = len(places)
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    for column, symmetry in enumerate(described.symmetries):
        partner = cloth.points.partners[:, column]
        assert sorted(partner) == list(range(count))
        np.testing.assert_array_equal(partner[partner], np.arange(count))
        np.testing.assert_allclose(apart[partner][:, partner], apart, atol=1e-6)
        mapped = symmetry.apply(cloth.points.material.astype(np.float64))
        np.testing.assert_allclose(cloth.points.material[partner], mapped, atol=1e-6)
    assert flat_cloth(proportion, "towel")[0].points.partners.shape == (count, 0)


@pytest.mark.parametrize("proportion", [0.6875, 1.625])
def test_weave_and_hem_have_one_width_and_a_plain_cloth_its_symmetries(proportion: float) -> None:
    towel = scene("towel", cloth=coarse(proportion))
    drawn = sample_appearance(np.random.default_rng(0), towel, AppearanceSettings())
    height = round(480 * proportion)
    front, back = cloth_images(replace(drawn, pattern="plain", back_colour=drawn.cloth_colours[0]),
                               proportion, 480)  # fmt: skip
    assert front.shape == (height, 480, 3)
    for image in (front, back):
        for mapped in (front[::-1, ::-1], front[::-1], front[:, ::-1]):
            np.testing.assert_allclose(mapped, image, atol=1e-6)
    # Minima of the weave along the middle row and the middle column: threads per pixel.
    threads = [
        np.sum((line[1:-1] < line[:-2]) & (line[1:-1] <= line[2:])) / len(line)
        for line in (front[height // 2, :, 0], front[:, 240, 0])
    ]
    assert threads[0] == pytest.approx(threads[1], rel=0.02)
    face = cloth_images(replace(drawn, weave_contrast=0.0), proportion, 480)[0]
    hem = (face == face[0, 0]).all(axis=2)
    widths = [int(np.argmin(hem[:, 60])), int(np.argmin(hem[height // 2]))]
    assert widths[0] == pytest.approx(0.03 * 480, abs=1)
    assert widths[1] == pytest.approx(0.03 * 480, abs=1)


@pytest.mark.parametrize(
    ("tier", "episodes", "cloth"),
    [
        ("cloth-2", True, {"proportion": 0.7}),
        ("towel", False, {"proportion": 1.6}),
        ("cloth-1", False, {"variant": "printed", "design": 3}),
    ],
)
def test_a_dataset_is_valid(tier: str, episodes: bool, cloth: dict, tmp_path: Path) -> None:
    settings = coarse(1.0).replace(**cloth)
    frames = 4 if episodes else 2
    config = small(tier, (160, 120), frames=frames, episodes=episodes, cloth=settings)
    dataset = made(config, tmp_path / "cloths")
    assert len(dataset.queries("test")) > 50
    lengths = [each.metres_per_unit for each in dataset.tiers[tier].queried.material]
    assert lengths == pytest.approx(LENGTHS_M[cloth.get("proportion", 1.0)])


COARSE = ClothSettings(points_a_side=33, tracked_a_side=17)


def faces_of(tier: str, settings: ClothSettings, sequence: int = 0) -> list[Float32Array]:
    """Return the front and the back of a sequence's cloth without its weave, 240 x 240."""
    cloth = scene(tier, split="test", index=sequence, cloth=settings)
    drawn = sample_appearance(np.random.default_rng(sequence), cloth, AppearanceSettings())
    return list(cloth_images(replace(drawn, weave_contrast=0.0), width=240))


def printed(design: int, sequence: int = 0) -> list[Float32Array]:
    return faces_of("cloth-1", COARSE.replace(variant="printed", design=design), sequence)


def pixels_of(each: Symmetry) -> tuple[NDArray[np.int64], ...]:
    """Return row and column of the pixel that a map sends each pixel to."""
    centre = (np.arange(240) + 0.5) / 240
    place = np.stack(np.meshgrid(centre, centre), axis=-1)
    column, row = np.floor(each.apply(place) * 240).astype(int).transpose(2, 0, 1)
    return row, column


@pytest.mark.parametrize("design", range(6))
def test_a_design_has_one_shape_in_all_colours_and_shows_on_the_back(design: int) -> None:
    def edges(face: Float32Array) -> NDArray[np.bool_]:
        """Where a face's colour changes from one row to the next."""
        return np.asarray((np.diff(face, axis=0) != 0).any(axis=2))

    (front, back), (other, _) = printed(design), printed(design, 1)
    assert np.abs(front - other).max() > 0.05
    assert (edges(front) == edges(other)).mean() > 0.999
    assert (edges(front) == edges(back)).mean() > 0.99
    spread = [face.std(axis=(0, 1)).max() for face in (front, back)]
    assert spread[1] == pytest.approx(0.3 * spread[0], rel=0.01)
    assert (edges(front) != edges(printed(design + 1)[0])).mean() > 0.02


@pytest.mark.parametrize("design", range(6))
def test_every_map_of_the_square_changes_a_design(design: int) -> None:
    front = printed(design)[0]
    for each in (*SQUARE_ROTATIONS, *SQUARE_MIRRORS):
        assert (front != front[pixels_of(each)]).any(axis=2).mean() > 0.03, each.name


def test_every_map_of_the_square_changes_a_towel_whatever_the_colours_are() -> None:
    front, back = (_regions(face) for face in faces_of("towel", COARSE))
    for each in (*SQUARE_ROTATIONS, *SQUARE_MIRRORS):
        # A mirror shows the other face: the towel was turned over. Its colours are exchanged, and
        # with a material that was never seen before nothing says which of them is the front's.
        other = front if each in SQUARE_ROTATIONS else back
        assert (front != other[pixels_of(each)]).mean() > 0.1, each.name


def _regions(face: Float32Array) -> NDArray[np.int64]:
    """Number the colours of a face by their share of it, the largest 0: int (H, W)."""
    flat = face.reshape(-1, 3)
    _, region, count = np.unique(flat, axis=0, return_inverse=True, return_counts=True)
    rank = np.argsort(np.argsort(-count))
    return rank[region.reshape(-1)].reshape(face.shape[:2])


def test_a_towel_has_one_answer_and_any_orientation() -> None:
    tier = describe_tier(GenerateConfig(tiers=("towel",), cloth=COARSE), "towel")
    assert (tier.kind, tier.variant, tier.symmetries) == ("cloth", "towel", ())
    towels = [scene("towel", split="test", index=k, cloth=COARSE) for k in range(4)]
    assert towels[0].points.partners.shape == (17 * 17, 0)
    yaw = [abs(float(each.pose(0).info["yaw_rad"])) for each in towels]
    assert max(yaw) > ClothSettings().yaw_max_rad + 0.5
