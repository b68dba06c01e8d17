"""The truth against Cycles' own passes, on a small scene of every tier."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.generator.scene.appearance import Light
from pliant.generator.scene.camera import sample_camera
from pliant.generator.settings import CameraSettings, ClothSettings
from pliant.generator.truth.frame_truth import frame_truth
from tests.generator.world import scene

SIZE = (320, 240)
COARSE_CLOTH = ClothSettings(points_a_side=25, tracked_a_side=9, coverage_band=(0.1, 1.1))


@pytest.mark.blender
@pytest.mark.parametrize("tier", ["rope", "cloth-1", "cloth-2", "cloth-3"])
def test_the_truth_equals_the_passes_of_cycles(tier: str) -> None:
    """Cycles works in float32: a pixel whose centre lies on an outline may fall either way."""
    from benchmarks.cycles_passes import PassRenderer, compare_with_cycles

    scene_object = scene(tier, cloth=COARSE_CLOTH)
    pose = scene_object.pose(0)
    renderer = PassRenderer(SIZE)
    ids, depths = 0, 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        camera = sample_camera(rng, scene_object, CameraSettings(), SIZE, [pose])
        truth = frame_truth(scene_object, pose, camera)
        found = compare_with_cycles(renderer, scene_object, truth, camera)
        assert found.object_pixels > 500
        ids += found.id_mismatch_px
        depths += found.depth_errors
    assert ids <= 1
    assert depths <= 2


@pytest.mark.blender
def test_light_without_a_sun_is_white() -> None:
    """The setting look.sun_share may be 0: the colour of no light was 0 / 0."""
    bpy = pytest.importorskip("bpy")
    from pliant.generator.rendering.blender import new_scene, place_light

    made = new_scene((16, 16), 1, gpu=False)
    for irradiance, energy, colour in (((0, 0, 0), 0, [1, 1, 1]), ((2, 4, 1), 4, [0.5, 1, 0.25])):
        place_light(made, Light((0, 0, 1), irradiance, 0.1, (1, 1, 1)))
        assert bpy.data.objects["sun"].data.energy == energy
        assert list(bpy.data.objects["sun"].data.color) == colour
