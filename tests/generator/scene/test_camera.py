from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pliant.generator.scene.camera import looking_at, sample_camera
from pliant.generator.scene.scene_object import SceneObject
from pliant.generator.settings.scene import CameraSettings
from pliant.spec.errors import CallError


def test_a_point_right_and_near_lands_right_and_below_the_middle() -> None:
    # 100 px a metre at 1 m: fov 90 over 200 px gives f = 100.
    camera = looking_at((0, 0, 2), (0, 0, 0), (200, 100), fov_deg=90.0)
    uvz = camera.project(np.array([[0.0, 0, 0], [1.0, 0, 0], [0, -0.5, 1.0], [0.2, 0.1, 0]]))
    np.testing.assert_allclose(uvz[0], [100, 50, 2], atol=1e-12)
    np.testing.assert_allclose(uvz[1], [150, 50, 2], atol=1e-12)
    np.testing.assert_allclose(uvz[2], [100, 100, 1], atol=1e-12)  # -y is towards the viewer
    np.testing.assert_allclose(uvz[3], [110, 45, 2], atol=1e-12)
    np.testing.assert_allclose(camera.centre_m, [0, 0, 2], atol=1e-12)


@pytest.mark.parametrize("settings", [CameraSettings(oblique=0.0), CameraSettings(top=0.0)])
def test_the_whole_object_is_framed(
    tube: SceneObject, sheet: SceneObject, settings: CameraSettings
) -> None:
    for seed in range(60):
        for scene_object in (tube, sheet):
            camera = sample_camera(np.random.default_rng(seed), scene_object, settings, (160, 120))
            points = np.concatenate(list(scene_object.pose(0).vertices.values()))
            uvz = camera.project(points)
            assert uvz[:, 0].min() > 3.0
            assert uvz[:, 0].max() < 157.0
            assert uvz[:, 1].min() > 2.0
            assert uvz[:, 1].max() < 118.0
            extent = np.ptp(uvz[:, :2], axis=0) / [160, 120]
            assert settings.fill[0] - 0.01 < extent.max() < settings.fill[1] + 0.01
            elevation = np.degrees(np.arcsin(-camera.world_to_camera[2, 2]))
            low, high = (86.0, 90.0) if settings.oblique == 0 else (42.0, 68.0)
            assert low - 1e-6 <= elevation <= high + 1e-6


@pytest.mark.parametrize(("elevation", "least"), [(5.0, 0.1), (40.0, 0.61)])
def test_a_wide_view_frames_the_whole_object_too(
    tube: SceneObject, sheet: SceneObject, elevation: float, least: float
) -> None:
    settings = CameraSettings(
        top=0.0, fov_deg=(90.0, 120.0), oblique_elevation_deg=(elevation, elevation)
    )
    for seed in range(12):
        for scene_object in (tube, sheet):
            camera = sample_camera(np.random.default_rng(seed), scene_object, settings, (161, 97))
            uv = camera.project(np.concatenate(list(scene_object.pose(0).vertices.values())))[:, :2]
            assert (uv > 0).all()
            assert (uv < camera.size).all()
            # Low views back off where the camera would be below the table.
            assert least < (np.ptp(uv, axis=0) / camera.size).max() < 0.87


def test_all_given_poses_are_framed(tube: SceneObject) -> None:
    poses = [tube.pose(0), tube.pose(60)]
    camera = sample_camera(np.random.default_rng(0), tube, CameraSettings(), (160, 120), poses)
    for pose in poses:
        uvz = camera.project(pose.vertices["rope"])
        assert (uvz[:, :2] > 0).all()
        assert (uvz[:, :2] < [160, 120]).all()


def test_an_episode_is_framed_with_its_workspace(tube: SceneObject) -> None:
    episode = dataclasses.replace(tube, temporal=True, info={"workspace_m": [1.4, 1.0]})
    still = dataclasses.replace(episode, temporal=False)
    corners = np.array([[1, 1, 0], [-1, 1, 0], [1, -1, 0.06], [-1, -1, 0.06]]) * [0.56, 0.4, 1]
    for seed in range(10):
        cameras = [
            sample_camera(np.random.default_rng(seed), each, CameraSettings(), (160, 120))
            for each in (episode, still)
        ]
        inside = [
            bool(((c.project(corners)[:, :2] > 0) & (c.project(corners)[:, :2] < [160, 120])).all())
            for c in cameras
        ]
        assert inside == [True, False]


def test_a_camera_inside_or_too_near_the_object_is_refused(tube: SceneObject) -> None:
    inside = CameraSettings(distance_m=(0.02, 0.02), oblique=1.0, top=0.0)
    with pytest.raises(CallError, match=r"camera\.distance_m.*inside"):
        sample_camera(np.random.default_rng(0), tube, inside, (64, 48))
    near = CameraSettings(distance_m=(0.3, 0.3))
    with pytest.raises(CallError, match=r"camera\.distance_m.*whole object"):
        sample_camera(np.random.default_rng(0), tube, near, (64, 48))
    far = CameraSettings(distance_m=(3.0, 3.0))
    camera = sample_camera(np.random.default_rng(0), tube, far, (64, 48))
    assert np.linalg.norm(camera.centre_m) == pytest.approx(3.0, abs=0.2)


def test_a_cloth_is_seen_upright_and_a_rope_from_anywhere(
    tube: SceneObject, sheet: SceneObject
) -> None:
    """The side of the object that the camera sees first, as an angle about the vertical."""
    settings = CameraSettings(top=0.0)

    def azimuths(scene_object: SceneObject, given: CameraSettings) -> np.ndarray:
        found = []
        for seed in range(60):
            camera = sample_camera(np.random.default_rng(seed), scene_object, given, (160, 120))
            ahead = camera.world_to_camera[2, :3]  # the camera's z axis in the world
            found.append(np.degrees(np.arctan2(-ahead[0], ahead[1])))
        return np.abs(found)

    assert azimuths(sheet, settings).max() <= 20.0 + 1e-6
    assert azimuths(sheet, settings).max() > 15.0
    assert azimuths(tube, settings).max() > 150.0
    anywhere = CameraSettings(top=0.0, oblique_azimuth_deg=(-180.0, 180.0))
    assert azimuths(sheet, anywhere).max() > 150.0
