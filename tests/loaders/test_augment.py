from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pliant.loaders.augment import (
    AugmentSettings,
    augment,
    draw_placement,
    given_masks,
    placement_in_image,
    renamed,
    rotation_about_centre,
    symmetry_in_image,
    warp_view,
)
from pliant.loaders.recolouring import recolour, recolour_regions
from pliant.loaders.views import TrainingFrame
from pliant.spec.model import SQUARE_MIRRORS, SQUARE_ROTATIONS, Symmetry

SIZE = (160, 120)


def blob_view(points: np.ndarray, sigma: float = 3.0) -> TrainingFrame:
    """One bright blob at each point, on black."""
    u, v = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    image = np.zeros((SIZE[1], SIZE[0]))
    for point in points:
        image += 250 * np.exp(-((u - point[0]) ** 2 + (v - point[1]) ** 2) / (2 * sigma**2))
    rgb = np.repeat(image.round().clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)
    mask = image > 30
    return TrainingFrame(
        rgb=rgb,
        mask=mask,
        objects=mask,
        depth_m=np.where(mask, np.float32(0.8), np.float32(np.inf)),
        uv_px=points.astype(np.float32),
        visible=np.ones(len(points), bool),
    )


def augmented(
    rng: np.random.Generator, view: TrainingFrame, settings: AugmentSettings
) -> TrainingFrame:
    return augment(rng, view, settings, draw_placement(rng, [view], settings))


def centre_near(image: np.ndarray, point: np.ndarray, radius: float = 12.0) -> np.ndarray:
    u, v = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    near = (u - point[0]) ** 2 + (v - point[1]) ** 2 <= radius**2
    weight = np.maximum(image - 12, 0) * near  # the faint tail is mostly rounding
    return np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()


@pytest.mark.parametrize("angle_deg", [0.0, 17.0, 90.0, -133.0, 180.0])
@pytest.mark.parametrize("scale", [1.0, 0.85])
def test_points_move_with_the_pixels(angle_deg: float, scale: float) -> None:
    points = np.array([[60.3, 45.8], [95.1, 70.2]])
    affine = rotation_about_centre(SIZE, math.radians(angle_deg), scale)
    moved = warp_view(blob_view(points), affine)
    for point in moved.uv_px:
        measured = centre_near(moved.rgb[..., 0].astype(float), point)
        np.testing.assert_allclose(measured, point, atol=0.03)


def test_a_quarter_turn_is_exact() -> None:
    """Turning by 90 degrees about the centre maps the centre of a square's pixel to another's."""
    square = (np.arange(64 * 64 * 3).reshape(64, 64, 3) % 251).astype(np.uint8)
    view = TrainingFrame(
        rgb=square,
        mask=np.zeros((64, 64), bool),
        objects=np.zeros((64, 64), bool),
        depth_m=np.ones((64, 64), np.float32),
        uv_px=np.array([[10.5, 20.5]], np.float32),
        visible=np.array([True]),
    )
    moved = warp_view(view, rotation_about_centre((64, 64), math.pi / 2))
    np.testing.assert_allclose(moved.uv_px, [[64 - 20.5, 10.5]], atol=1e-5)
    np.testing.assert_allclose(  # one level for the interpolation's rounding
        moved.rgb[2:-2, 2:-2].astype(int), np.rot90(square, -1)[2:-2, 2:-2].astype(int), atol=1
    )


def test_points_that_leave_the_image_are_not_visible() -> None:
    view = blob_view(np.array([[80.0, 60.0], [155.0, 60.0]]))
    moved = warp_view(view, rotation_about_centre(SIZE, math.pi / 2))
    assert moved.visible.tolist() == [True, False]


def test_mask_and_depth_move_together() -> None:
    view = blob_view(np.array([[50.0, 50.0], [100.0, 80.0]]))
    moved = warp_view(view, rotation_about_centre(SIZE, 0.7))
    np.testing.assert_array_equal(moved.mask, np.isfinite(moved.depth_m))
    assert moved.mask.sum() == pytest.approx(view.mask.sum(), rel=0.05)


def with_ball() -> TrainingFrame:
    """A view whose second blob belongs to another object than the queried one."""
    view = blob_view(np.array([[50.0, 50.0], [110.0, 60.0]]))
    own = view.mask & (np.arange(SIZE[0]) < 80)
    return replace(view, mask=own)


def test_colour_keeps_the_order_of_values_and_noise_has_its_size() -> None:
    rng = np.random.default_rng(3)
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    for _ in range(10):
        changed = recolour(rng, ramp, 0.4, 0.0)
        assert (np.diff(changed[0].astype(int), axis=0) >= 0).all()
    flat = np.full((200, 200, 3), 128, np.uint8)
    spread = [float(recolour(rng, flat, 0.0, 8.0).std()) for _ in range(40)]
    assert max(spread) < 8.5
    assert max(spread) > 4


def test_all_off_changes_nothing() -> None:
    view = blob_view(np.array([[50.0, 50.0]]))
    settings = AugmentSettings(rotate_deg=0, scale=0, colour=0, noise=0)
    same = augmented(np.random.default_rng(0), view, settings)
    np.testing.assert_array_equal(same.rgb, view.rgb)
    np.testing.assert_array_equal(same.uv_px, view.uv_px)


@pytest.mark.parametrize("angle_deg", [0.0, 90.0, 37.0, -160.0])
def test_a_turned_object_stays_in_the_image(angle_deg: float) -> None:
    """A line of 140 px across the image fits upright only if it shrinks to 120 - 2 x 7 px."""
    line = np.column_stack([np.linspace(10, 150, 29), np.full(29, 60.0)])
    affine = placement_in_image(
        np.random.default_rng(1), line, SIZE, math.radians(angle_deg), 1.0, 7.0
    )
    moved = line @ affine[:, :2].T + affine[:, 2]
    assert (moved >= 7 - 1e-9).all()
    assert (moved <= np.array(SIZE) - 7 + 1e-9).all()
    factor = math.sqrt(np.linalg.det(affine[:, :2]))
    if angle_deg == 90.0:
        assert factor == pytest.approx(106 / 140)
    elif angle_deg == 0.0:
        assert factor == pytest.approx(1.0)
    heading = np.degrees(np.arctan2(*(moved[-1] - moved[0])[::-1]))
    assert heading == pytest.approx(angle_deg)


def test_an_object_is_laid_anywhere_it_fits() -> None:
    rng = np.random.default_rng(0)
    points = np.array([[70.0, 50.0], [90.0, 60.0]])
    middles = []
    for _ in range(200):
        affine = placement_in_image(rng, points, SIZE, 0.0, 1.0, 5.0)
        middles.append((points @ affine[:, :2].T + affine[:, 2]).mean(axis=0))
    low, high = np.min(middles, axis=0), np.max(middles, axis=0)
    np.testing.assert_allclose(low, [5 + 10, 5 + 5], atol=4)
    np.testing.assert_allclose(high, [160 - 15, 120 - 10], atol=4)


def test_augmentation_leaves_no_point_outside() -> None:
    line = blob_view(np.column_stack([np.linspace(10, 150, 9), np.full(9, 60.0)]))
    settings = AugmentSettings(rotate_deg=180, scale=0.2, colour=0, noise=0, margin=0.05)
    rng = np.random.default_rng(4)
    assert all(augmented(rng, line, settings).visible.all() for _ in range(20))


def test_regions_get_colours_of_their_own() -> None:
    """The mean colour of each region is drawn alone; its pattern stays, up to sign and gain."""
    view = with_ball()
    rng = np.random.default_rng(5)
    regions = {"own": view.mask, "ball": view.objects & ~view.mask, "table": ~view.objects}
    means = {name: [] for name in regions}  # type: ignore[var-annotated]
    correlated = []
    for _ in range(60):
        rgb = recolour_regions(rng, view.rgb, view.mask, view.objects).astype(float)
        for name, region in regions.items():
            means[name].append(rgb[region].mean())
        before, after = view.rgb[view.mask][:, 0].astype(float), rgb[view.mask][:, 0]
        correlated.append(np.corrcoef(before, after)[0, 1])
    for name in regions:
        assert np.std(means[name]) > 25, name
    assert abs(np.corrcoef(means["own"], means["ball"])[0, 1]) < 0.5
    assert min(correlated) < -0.5
    assert max(correlated) > 0.5


def both_masks(
    rng: np.random.Generator, view: TrainingFrame, settings: AugmentSettings
) -> tuple[np.ndarray, np.ndarray]:
    mask, objects = given_masks(rng, view, settings)
    assert mask is not None
    assert objects is not None
    return mask, objects


def test_masks_are_exact_unless_faults_are_asked_for() -> None:
    view = with_ball()
    exact = both_masks(np.random.default_rng(0), view, AugmentSettings())
    np.testing.assert_array_equal(exact, [view.mask, view.objects])


def test_faulty_masks_shrink_grow_and_have_holes() -> None:
    view = with_ball()
    rng = np.random.default_rng(1)
    settings = AugmentSettings(mask_faults=1)
    areas = set()
    for _ in range(40):
        mask, objects = both_masks(rng, view, settings)
        assert not (mask & ~objects).any()
        areas.add(int(mask.sum()))
    assert min(areas) < view.mask.sum() < max(areas)


@pytest.mark.parametrize("symmetry", [*SQUARE_ROTATIONS, *SQUARE_MIRRORS], ids=lambda s: s.name)
def test_an_upright_cloth_stays_upright_under_its_symmetries(symmetry: Symmetry) -> None:
    """The blob moves to the material point that the symmetry names; u still runs right, v up."""
    side = np.linspace(0, 1, 11)
    material = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    upright = np.array([50.0, 90.0]) + material * [60.0, -60.0]
    blob = np.flatnonzero(np.isclose(material, [0.2, 0.3]).all(axis=1))
    view = replace(
        blob_view(upright[blob]), uv_px=upright.astype(np.float32), visible=np.ones(121, bool)
    )
    goal = symmetry.apply(material)
    partners = np.array([np.linalg.norm(material - each, axis=1).argmin() for each in goal])

    still = AugmentSettings(rotate_deg=0, scale=0)
    first = symmetry_in_image(symmetry)
    affine = draw_placement(np.random.default_rng(4), [view], still, first)
    assert affine is not None
    moved = renamed(warp_view(view, affine), partners)

    named = material[np.linalg.norm(moved.uv_px - centre_of(moved.rgb), axis=1).argmin()]
    np.testing.assert_allclose(named, symmetry.apply(np.array([0.2, 0.3])), atol=1e-9)
    rows = np.column_stack([material, np.ones(121)])
    slope = np.linalg.lstsq(rows, moved.uv_px, rcond=None)[0][:2]
    np.testing.assert_allclose(slope, np.diag([slope[0, 0], slope[1, 1]]), atol=1e-3)
    assert slope[0, 0] > 0 > slope[1, 1]


def centre_of(rgb: np.ndarray) -> np.ndarray:
    v, u = np.unravel_index(rgb[..., 0].argmax(), rgb.shape[:2])
    return np.array([u + 0.5, v + 0.5])
