"""The variant `printed`: one design in any colours, which no map of the cloth leaves alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pliant.generator.objects.tiers import describe_tier, sample_scene_object
from pliant.generator.rendering.materials import cloth_images
from pliant.generator.scene.appearance import sample_appearance
from pliant.generator.seeding import SequenceTask
from pliant.generator.settings import AppearanceSettings, ClothSettings
from pliant.spec.model import SQUARE_MIRRORS, SQUARE_ROTATIONS
from tests.generator.world import made, small


def cloth(design: int) -> ClothSettings:
    return ClothSettings(variant="printed", design=design, points_a_side=33, tracked_a_side=17)


def faces_of(design: int, sequence: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    config = small("cloth-1", (160, 120), cloth=cloth(design))
    sheet = sample_scene_object(config, SequenceTask("cloth-1", "test", sequence))
    drawn = sample_appearance(np.random.default_rng(sequence), sheet, AppearanceSettings())
    return cloth_images(replace(drawn, weave_contrast=0.0), width=240)


def edges(face: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Where a face's colour changes from one row to the next."""
    return np.asarray((np.diff(face, axis=0) != 0).any(axis=2))


@pytest.mark.parametrize("design", range(6))
def test_a_design_has_one_shape_in_all_colours_and_shows_on_the_back(design: int) -> None:
    (front, back), (other, _) = faces_of(design, 0), faces_of(design, 1)
    assert np.abs(front - other).max() > 0.05
    assert (edges(front) == edges(other)).mean() > 0.999
    assert (edges(front) == edges(back)).mean() > 0.99
    spread = [face.std(axis=(0, 1)).max() for face in (front, back)]
    assert spread[1] == pytest.approx(0.3 * spread[0], rel=0.01)
    assert (edges(front) != edges(faces_of(design + 1, 0)[0])).mean() > 0.02


@pytest.mark.parametrize("design", range(6))
def test_every_map_of_the_square_changes_a_design(design: int) -> None:
    front = faces_of(design, 0)[0]
    centre = (np.arange(240) + 0.5) / 240
    place = np.stack(np.meshgrid(centre, centre), axis=-1)
    for each in (*SQUARE_ROTATIONS, *SQUARE_MIRRORS):
        column, row = np.floor(each.apply(place) * 240).astype(int).transpose(2, 0, 1)
        assert (front != front[row, column]).any(axis=2).mean() > 0.03, each.name


def test_a_dataset_of_printed_cloths_is_valid_and_has_one_answer(tmp_path: Path) -> None:
    config = small("cloth-1", (160, 120), cloth=cloth(3))
    tier = describe_tier(config, "cloth-1")
    assert (tier.variant, tier.symmetries) == ("printed", ())
    assert len(made(config, tmp_path / "printed").queries("test")) > 50
