"""The tier `towel`: one answer a point whatever the colours are, and it lies at any angle."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pliant.generator.objects.tiers import describe_tier, sample_scene_object
from pliant.generator.rendering.materials import cloth_images
from pliant.generator.scene.appearance import sample_appearance
from pliant.generator.seeding import SequenceTask
from pliant.generator.settings import AppearanceSettings, ClothSettings
from pliant.spec.model import SQUARE_MIRRORS, SQUARE_ROTATIONS
from tests.generator.world import made, small

CONFIG = small("towel", (160, 120), cloth=ClothSettings(points_a_side=33, tracked_a_side=17))


def test_every_map_of_the_square_changes_the_pattern_whatever_the_colours_are() -> None:
    towel = sample_scene_object(CONFIG, SequenceTask("towel", "test", 0))
    drawn = sample_appearance(np.random.default_rng(0), towel, AppearanceSettings())
    faces = cloth_images(replace(drawn, weave_contrast=0.0), width=240)
    front, back = (_regions(face) for face in faces)
    centre = (np.arange(240) + 0.5) / 240
    u, v = np.meshgrid(centre, centre)
    for each in (*SQUARE_ROTATIONS, *SQUARE_MIRRORS):
        mapped = each.apply(np.stack([u, v], axis=-1))
        column, row = np.floor(mapped * 240).astype(int).transpose(2, 0, 1)
        # A mirror shows the other face: the towel was turned over. Its colours are exchanged, and
        # with a material that was never seen before nothing says which of them is the front's.
        other = front if each in SQUARE_ROTATIONS else back
        assert (front != other[row, column]).mean() > 0.1, each.name


def _regions(face: NDArray[np.float32]) -> NDArray[np.int64]:
    """Number the colours of a face by their share of it, the largest 0: int (H, W)."""
    flat = face.reshape(-1, 3)
    _, region, count = np.unique(flat, axis=0, return_inverse=True, return_counts=True)
    rank = np.argsort(np.argsort(-count))
    return rank[region.reshape(-1)].reshape(face.shape[:2])


def test_a_towel_has_one_answer_and_any_orientation() -> None:
    tier = describe_tier(CONFIG, "towel")
    assert (tier.kind, tier.variant, tier.symmetries) == ("cloth", "towel", ())
    towels = [sample_scene_object(CONFIG, SequenceTask("towel", "test", k)) for k in range(4)]
    assert towels[0].points.partners.shape == (17 * 17, 0)
    yaw = [abs(float(each.pose(0).info["yaw_rad"])) for each in towels]
    assert max(yaw) > ClothSettings().yaw_max_rad + 0.5


def test_a_dataset_of_towels_is_valid(tmp_path: Path) -> None:
    assert len(made(CONFIG, tmp_path / "towels").queries("test")) > 50
