"""The style `real-depth`: what a depth camera makes of exact depth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.generator.rendering import open_renderer
from pliant.generator.rendering.depth_camera import (
    depth_picture,
    pixels_to_the_rim,
    slope_to_the_right,
    table_distance_m,
)
from pliant.generator.runner.sequence import SequenceMaker
from pliant.generator.scene.camera import looking_at
from pliant.generator.scene.scene_object import SceneObject
from pliant.generator.seeding import RandomStreams, SequenceTask, Stream
from pliant.generator.settings import DepthCameraSettings
from pliant.generator.truth.frame_truth import FrameTruth, frame_truth
from tests.generator.world import small

SIZE = (160, 120)
VIEW = looking_at((0.1, -0.2, 0.8), (0.0, 0.0, 0.0), SIZE, fov_deg=50.0)
APPEARANCE: Any = None  # shows nowhere
FAULTLESS = DepthCameraSettings(
    table_grey=(150.0, 150.0),
    noise_grey=(0.0, 0.0),
    steepest=(100.0, 100.0),
    frayed_px=(0.0, 0.0),
    pinholes=(0.0, 0.0),
    specks=(0.0, 0.0),
)


def draw(depth_m: np.ndarray, settings: DepthCameraSettings, seed: int = 0) -> np.ndarray:
    return depth_picture(np.random.default_rng(seed), depth_m, 100.0, 1.0, settings)


def plate(height: int = 40, width: int = 60) -> np.ndarray:
    """A plate 0.9 m away, 10 px from the frame on every side."""
    depth_m = np.full((height, width), np.inf, np.float32)
    depth_m[10:-10, 10:-10] = 0.9
    return depth_m


def seen(scene_object: SceneObject, settings: DepthCameraSettings) -> tuple[np.ndarray, FrameTruth]:
    renderer = open_renderer("real-depth", SIZE, depth_camera=settings)
    renderer.begin(scene_object, APPEARANCE, VIEW)
    truth = frame_truth(scene_object, scene_object.pose(0), VIEW)
    rgb = renderer.render(scene_object.pose(0), truth, np.random.default_rng(0))
    return rgb, truth


def test_without_faults_grey_is_depth(either: SceneObject) -> None:
    rgb, truth = seen(either, FAULTLESS)
    depth_m = truth.surface.depth_m
    on = np.isfinite(depth_m)
    # The camera looks at the world's origin, which lies on the table.
    table_m = float(np.linalg.norm(VIEW.centre_m))
    assert table_distance_m(VIEW) == pytest.approx(table_m)
    assert (rgb[~on] == 0).all()
    np.testing.assert_array_equal(
        rgb[on], np.rint(150 * depth_m[on] / table_m)[:, None].repeat(3, 1)
    )


def test_faults_follow_from_the_datasets_seed(tmp_path: Path, tube: SceneObject) -> None:
    """Frames of equal depth have other faults in every dataset, sequence and frame."""
    truth = frame_truth(tube, tube.pose(0), VIEW)
    pictures = {}
    for seed in (1, 2):
        config = small(size=SIZE, frames=2, style="real-depth", seed=seed)
        maker = SequenceMaker(config, tmp_path / str(seed))
        maker.renderer.begin(tube, APPEARANCE, VIEW)
        for index in range(2):
            streams = RandomStreams(seed, SequenceTask("rope", "test", index))
            for frame in range(2):
                rng = streams.generator(Stream.DEPTH_CAMERA, frame)
                rgb = maker.renderer.render(tube.pose(0), truth, rng)
                pictures[seed, index, frame] = rgb.tobytes()
    assert len(set(pictures.values())) == 8
    with pytest.raises(ValueError, match="needs a random generator"):
        maker.renderer.render(tube.pose(0), truth)


def test_greys_of_a_frame_lie_close_together(tube: SceneObject) -> None:
    """A table-top scene takes a few steps of a scale that reaches far beyond it."""
    rgb, truth = seen(tube, DepthCameraSettings(specks=(0, 0)))
    on = np.isfinite(truth.surface.depth_m)
    values = rgb[..., 0][rgb[..., 0] > 0]
    assert (rgb == rgb[..., :1]).all()
    assert values.min() > 110
    assert values.max() < 175
    assert 3 < len(np.unique(values)) < 60
    assert (rgb[~on] == 0).all()
    assert 0.5 < (rgb[on] > 0).mean(axis=0)[0] < 1.0


def test_a_flat_plate_is_changed_near_its_outline_alone() -> None:
    settings = FAULTLESS.replace(frayed_px=(1.5, 1.5))
    depth_m = plate()
    on = np.isfinite(depth_m)
    pictures = np.array([draw(depth_m, settings, seed) for seed in range(30)])
    lost = (pictures == 0) & on
    assert (pictures[:, ~on] == 0).all()
    assert set(np.unique(pictures[:, on])) == {0, 135}
    left, right = lost[:, :, 10:30].mean(), lost[:, :, 30:50].mean()
    assert right > 0.01
    assert left < 0.5 * right  # the projector stands to the left
    assert not lost[:, 10:30, 20:38].any()
    lengths = lost[:, 10:30, 30:50].sum(axis=2)
    assert lengths.std() > 0.5  # rows lose lengths of their own


def test_steep_ground_is_lost_where_it_falls_to_the_right() -> None:
    """A ridge along the rows' normal: 45 degrees up, 45 degrees down."""
    u = np.arange(60)
    depth_m = plate()
    depth_m[10:-10] -= np.where(np.isfinite(depth_m[10:-10]), (20 - abs(u - 30)) * 0.009, 0)
    depth_m = depth_m.astype(np.float32)
    grey = draw(depth_m, FAULTLESS.replace(steepest=(0.5, 0.5)))
    up, down = grey[10:30, 12:28], grey[10:30, 33:48]
    assert (up > 0).mean() > 0.95
    assert (down > 0).mean() < 0.05
    turned = draw(depth_m.T, FAULTLESS.replace(steepest=(0.5, 0.5)))
    assert (turned[10:-10, 10:-10] > 0).all()  # a ridge along the rows throws no shadow


def test_slope_by_hand() -> None:
    depth_m = np.array([[1.0, 1.0, 1.02, 9.0, 2.0]])
    on = np.array([[True, True, True, False, True]])
    # 0.02 m over one pixel of 1 / 50 m; the middle pixel has a flat and a steep side.
    slope = slope_to_the_right(depth_m, on, 50.0)
    np.testing.assert_allclose(slope, [[0.0, 0.5, 1 / 1.02, 0.0, 0.0]])


def test_pixels_to_the_rim_by_hand() -> None:
    on = np.array([[0, 1, 1, 1, 0, 1], [1, 0, 0, 1, 1, 1]], bool)
    assert pixels_to_the_rim(on).tolist() == [[0, 2, 1, 0, 0, 0], [0, 0, 0, 2, 1, 0]]


def test_pinholes_specks_and_noise() -> None:
    depth_m = plate(120, 160)
    on = np.isfinite(depth_m)
    holed = draw(depth_m, FAULTLESS.replace(pinholes=(0.1, 0.1)))
    assert (holed[on] == 0).mean() == pytest.approx(0.1, abs=0.02)
    assert (holed[~on] == 0).all()
    specked = draw(depth_m, FAULTLESS.replace(specks=(40, 40)))
    assert (specked[on] == 135).all()
    assert 0.001 < (specked[~on] > 0).mean() < 0.05
    noisy = draw(depth_m, FAULTLESS.replace(noise_grey=(2, 2)))[on]
    assert noisy.std() == pytest.approx(2.0, abs=0.15)
