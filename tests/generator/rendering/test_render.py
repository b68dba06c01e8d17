from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy import ndimage

from pliant.generator.rendering import open_renderer
from pliant.generator.rendering.shadow import may_shade, shadow_map, sunlight
from pliant.generator.rendering.sky import openness, sky_maps
from pliant.generator.rendering.srgb import encode_srgb
from pliant.generator.rendering.table import TableView
from pliant.generator.scene.appearance import Appearance, Light, TableAppearance, sample_appearance
from pliant.generator.scene.camera import looking_at
from pliant.generator.scene.scene_object import SceneMesh, SceneObject
from pliant.generator.settings import AppearanceSettings
from pliant.generator.truth.frame_truth import frame_truth
from pliant.spec.camera import Camera
from pliant.spec.errors import CallError
from tests.generator.world import srgb_curve

SIZE = (160, 120)
VIEW = looking_at((0.15, -0.6, 0.75), (0.0, 0.0, 0.0), SIZE, fov_deg=50.0)
HIGH_SUN = Light((0.6, 0.0, 0.8), (2.0, 2.0, 2.0), math.radians(3.0), (0.3, 0.3, 0.3))


def plain_appearance(scene_object: SceneObject, **values: object) -> Appearance:
    settings = AppearanceSettings(tables={"mottled": 1.0}, specular=(0.2, 0.2), **values)  # type: ignore[arg-type]
    return sample_appearance(np.random.default_rng(3), scene_object, settings)


def in_high_sun(scene_object: SceneObject) -> Appearance:
    """Return the look of a scene on a plain table, whose light is known."""
    table = TableAppearance("plain", (0.5, 0.25, 0.1), 0.0, 0.1, 0.0, 0)
    appearance = sample_appearance(np.random.default_rng(0), scene_object, AppearanceSettings())
    return replace(appearance, light=HIGH_SUN, table=table)


def picture(
    style: str,
    scene_object: SceneObject,
    appearance: Appearance,
    threads: int = 1,
    samples: int | None = None,
) -> np.ndarray:
    renderer: Any = open_renderer(style, SIZE, threads, gpu=False)
    if samples is not None:
        renderer._scene.cycles.samples = samples
        renderer._scene.cycles.use_denoising = False
    renderer.begin(scene_object, appearance, VIEW)
    pose = scene_object.pose(0)
    rng = np.random.default_rng(0)
    rgb: np.ndarray = renderer.render(pose, frame_truth(scene_object, pose, VIEW), rng)
    return rgb


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / ((a.astype(float) - b) ** 2).mean()))


def test_srgb_is_the_standards_curve() -> None:
    linear = np.linspace(0, 1, 1000)
    got = encode_srgb(linear.reshape(-1, 1, 1).repeat(3, 2))[:, 0, 0]
    assert np.abs(got - 255 * srgb_curve(linear)).max() < 1.0
    assert encode_srgb(np.array([[[-1.0, 0.0, 9.0]]])).tolist() == [[[0, 0, 255]]]


def _plate(height: float) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[-0.4, -0.4], [0.4, -0.4], [0.4, 0.4], [-0.4, 0.4]])
    vertices = np.concatenate([corners, np.full((4, 1), height)], axis=1)
    return vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def test_a_shadow_falls_where_the_sun_says_and_is_half_at_its_edge() -> None:
    # The sun stands 4 : 3; a plate 0.2 m up throws its shadow 0.15 m towards -x.
    vertices, faces = _plate(0.2)
    shadow = shadow_map(vertices, faces, HIGH_SUN)

    def lit(x: float) -> float:
        places = [sunlight(x, 0.001 * k, 0.0, k, k // 4, *shadow) for k in range(16)]
        return float(np.mean(places))

    assert lit(-0.15) == 0.0
    assert lit(-0.54) == 0.0
    assert lit(0.27) == 1.0
    assert lit(-0.60) == 1.0
    assert lit(-0.55) == pytest.approx(0.5, abs=0.15)
    # Light travels 0.25 m from the plate: the penumbra reaches tan(1.5 deg) 0.25 / 0.8 to a side.
    assert 0.5 < lit(-0.55 - 0.005) < 1.0
    assert 0.0 < lit(-0.55 + 0.005) < 0.5


def test_no_place_in_a_box_that_is_skipped_misses_sunlight() -> None:
    vertices, faces = _plate(0.2)
    small = vertices * [0.2, 0.2, 1.0]  # two of them, across a gap
    away = np.array([0.3, 0.3, 0.0])
    two = np.concatenate([small - away, small + away])
    shadow = shadow_map(two, np.concatenate([faces, faces + np.int32(4)]), HIGH_SUN)
    rng = np.random.default_rng(0)
    skipped = 0
    for low in rng.uniform(-1.0, 0.8, (1000, 2)):
        high = low + 0.2
        places = [sunlight(x, y, 0.0, 0, 0, *shadow) for x, y in rng.uniform(low, high, (20, 2))]
        if not may_shade(np.stack([low, high]), shadow):
            skipped += 1
            assert min(places) == 1.0
    assert 500 < skipped < 950


def test_the_sky_under_a_plate_is_dark_and_far_away_open() -> None:
    grid = np.stack(np.meshgrid(*[np.linspace(-0.1, 0.1, 60)] * 2), axis=-1).reshape(-1, 2)
    sky = sky_maps(np.concatenate([grid, np.full((len(grid), 1), 0.03)], axis=1))
    places = np.array([[0.0, 0, 0], [0.12, 0, 0], [1.0, 0, 0], [0.0, 0, 0.03]])
    up = np.broadcast_to([0.0, 0, 1], places.shape).copy()
    under, beside, far, above = openness(places, up, sky)
    assert under < 0.2
    assert 0.5 < beside < 0.95
    assert far == 1.0
    assert above > 0.95


def test_the_open_table_is_bright_by_the_formula(sheet: SceneObject) -> None:
    appearance = in_high_sun(sheet)
    view = TableView(VIEW, appearance)
    expected = np.array(appearance.table.colour) * (2.0 * 0.8 / math.pi + 0.3)
    np.testing.assert_allclose(view.linear, np.broadcast_to(expected, view.linear.shape), rtol=1e-6)
    world = SceneMesh.of(sheet).vertices(sheet.pose(0))
    shadow = shadow_map(world, sheet.parts[0].faces, HIGH_SUN)
    linear, changed = view.under(shadow, sky_maps(world))
    assert (linear <= view.linear + 1e-6).all()
    np.testing.assert_array_equal(linear[~changed], view.linear[~changed])
    assert 0.05 < changed.mean() < 0.9


def test_the_horizon_has_no_steps(sheet: SceneObject) -> None:
    """A pixel on the horizon is the mean of its parts, seen with 8 times the pixels."""
    up = (0.3, 0.0, 1.0)
    appearance = in_high_sun(sheet)
    coarse, fine = (
        TableView(
            looking_at((0.1, -0.6, 0.1), (0, 0, 0.02), (40 * k, 30 * k), fov_deg=80.0, up=up),
            appearance,
        ).linear
        for k in (1, 8)
    )
    mean = fine.reshape(30, 8, 40, 8, 3).mean(axis=(1, 3))
    contrast = np.ptp(mean, axis=(0, 1)).max()
    assert np.abs(coarse - mean).max() < 0.1 * contrast


def test_raster_shows_the_object_where_the_truth_says(either: SceneObject) -> None:
    appearance = plain_appearance(either)
    rgb = picture("raster", either, appearance)
    truth = frame_truth(either, either.pose(0), VIEW)
    table = TableView(VIEW, appearance).encoded
    on = truth.surface.object_id == 1
    assert rgb.shape == (120, 160, 3)
    brighter = rgb.astype(int) > table.astype(int) + 6
    # Only an object can be brighter than the open table; no pixel away from it is.
    near = ndimage.binary_dilation(truth.surface.object_id > 0, np.ones((3, 3)))
    assert not brighter[~near].any()
    assert (np.abs(rgb.astype(int) - table)[on].max(axis=1) > 10).mean() > 0.9


def test_raster_needs_no_blender() -> None:
    code = (
        "import sys; sys.modules['bpy'] = None\n"
        "from pliant.generator.rendering import open_renderer\n"
        "open_renderer('raster', (32, 24)); assert 'cycles' not in sys.modules\n"
        "from pliant.spec.errors import MissingExtraError\n"
        "try: open_renderer('fast', (32, 24))\n"
        "except MissingExtraError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=Path("/"), check=True
    )
    assert "pliant[generate]" in done.stdout


def test_an_unknown_style_is_refused() -> None:
    with pytest.raises(CallError, match="style"):
        open_renderer("oil", SIZE)


@pytest.mark.blender
def test_the_styles_show_one_scene(either: SceneObject) -> None:
    """Cycles, the composite and our own shading differ by noise and fine shading only."""
    appearance = plain_appearance(either)
    photo, fast, raster = (
        picture(style, either, appearance) for style in ("photo", "fast", "raster")
    )
    assert psnr(fast, photo) > 31
    assert psnr(raster, photo) > 28
    shifted = np.roll(raster, 2, axis=1)  # a view two pixels off is told apart
    assert psnr(shifted, photo) < psnr(raster, photo) - 3


class Sampled(NamedTuple):
    """A scene, its picture with 192 samples a pixel, and where its object is."""

    scene_object: SceneObject
    appearance: Appearance
    rgb: np.ndarray
    on: np.ndarray


@pytest.fixture(scope="module", params=["tube", "sheet"])
def sampled(request: pytest.FixtureRequest) -> Sampled:
    scene_object: SceneObject = request.getfixturevalue(request.param)
    appearance = plain_appearance(scene_object)
    rgb = picture("photo", scene_object, appearance, samples=192)
    on = frame_truth(scene_object, scene_object.pose(0), VIEW).surface.object_id > 0
    return Sampled(scene_object, appearance, rgb, on)


@pytest.mark.blender
def test_fast_has_no_grain(sampled: Sampled) -> None:
    """Against 192 samples a pixel, on the object; four samples, not denoised, have 36 and 44 dB."""
    fast = picture("fast", sampled.scene_object, sampled.appearance)
    inside = ndimage.binary_erosion(sampled.on, iterations=2)
    least = {"rope": 38, "cloth": 48}[sampled.scene_object.kind]
    assert psnr(fast[inside], sampled.rgb[inside]) > least


@pytest.mark.blender
def test_a_small_photo_has_no_grain_and_no_steps(sampled: Sampled) -> None:
    """Against 192 samples a pixel, along the outline."""
    photo = picture("photo", sampled.scene_object, sampled.appearance)
    outline = ndimage.binary_dilation(sampled.on) & ~ndimage.binary_erosion(sampled.on)
    assert psnr(photo[outline], sampled.rgb[outline]) > 31


@pytest.mark.blender
def test_the_edges_of_fast_are_the_share_of_a_pixel_that_is_covered() -> None:
    """A plate whose left edge goes through the pixels of one column, at quarters of their width."""
    from pliant.generator.rendering.cycles_styles import FastRenderer

    window = (10, 50, 10, 40)
    camera = looking_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), SIZE, fov_deg=50.0)
    for eighths, share in ((0, 1.0), (2, 0.8984), (4, 0.5), (6, 0.1016), (8, 0.0)):
        renderer: Any = object.__new__(FastRenderer)
        left = camera_edge(camera, 30 + eighths / 8)
        renderer._camera = camera
        renderer._mesh = SimpleNamespace(faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32))
        corners = np.array([[left, -9.0, 0], [9, -9, 0], [9, 9, 0], [left, 9, 0]])
        covered = renderer._covered(corners, window)
        assert covered.shape == (30, 40)
        np.testing.assert_allclose(covered[:, :20], 0, atol=1e-6)
        np.testing.assert_allclose(covered[:, 20], share, atol=1e-6)
        np.testing.assert_allclose(covered[:, 21:], 1, atol=1e-6)


def camera_edge(camera: Camera, u_px: float) -> float:
    """Return the x on the table that a camera above it sees at a column, metres."""
    at = camera.project(np.array([[0.0, 0, 0], [1, 0, 0]]))[:, 0]
    return float((u_px - at[0]) / (at[1] - at[0]))


@pytest.mark.parametrize(
    "style",
    [
        "raster",
        "real-depth",
        pytest.param("fast", marks=pytest.mark.blender),
        pytest.param("photo", marks=pytest.mark.blender),
    ],
)
def test_bytes_depend_on_nothing_but_the_scene(
    style: str, tube: SceneObject, sheet: SceneObject
) -> None:
    """Neither on the number of threads, nor on what the process rendered before."""
    first = picture(style, sheet, plain_appearance(sheet), threads=1)
    renderer = open_renderer(style, SIZE, 2, gpu=False)

    def rendered(scene_object: SceneObject, frame: int) -> np.ndarray:
        pose = scene_object.pose(frame)
        truth = frame_truth(scene_object, pose, VIEW)
        return renderer.render(pose, truth, np.random.default_rng(0))

    for scene_object in (tube, sheet, tube, sheet):
        renderer.begin(scene_object, plain_appearance(scene_object), VIEW)
        rendered(scene_object, 1)
        rgb = rendered(scene_object, 0)
    np.testing.assert_array_equal(rgb, first)
    assert rendered(sheet, 0) is not rgb


@pytest.mark.blender
def test_blender_prints_nothing(tube: SceneObject, capfd: pytest.CaptureFixture[str]) -> None:
    picture("fast", tube, plain_appearance(tube))
    assert capfd.readouterr().out == ""


@pytest.mark.blender
def test_an_object_out_of_frame_leaves_the_table(tube: SceneObject) -> None:
    away = looking_at((9.0, 9.0, 1.0), (9.0, 9.3, 0.0), SIZE)
    appearance = plain_appearance(tube)
    for style in ("raster", "fast"):
        renderer = open_renderer(style, SIZE, gpu=False)
        renderer.begin(tube, appearance, away)
        rgb = renderer.render(tube.pose(0), frame_truth(tube, tube.pose(0), away))
        np.testing.assert_array_equal(rgb, TableView(away, appearance).encoded)
