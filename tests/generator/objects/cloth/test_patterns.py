"""Towels and prints: one pattern in any colours, which no map of the cloth leaves alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.tiers import describe_tier
from pliant.generator.rendering.materials import cloth_images
from pliant.generator.scene.appearance import sample_appearance
from pliant.generator.settings import AppearanceSettings, ClothSettings
from pliant.spec.arrays import Float32Array
from pliant.spec.model import SQUARE_MIRRORS, SQUARE_ROTATIONS, Symmetry
from tests.generator.world import scene

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
