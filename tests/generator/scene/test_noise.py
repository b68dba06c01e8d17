from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from pliant.generator.scene.noise import apply_noise
from pliant.generator.settings.scene import NoiseSettings
from pliant.spec.io.exr import Surface

OFF = {
    "gaussian": (0.0, 0.0),
    "photons": (0.0, 0.0),
    "salt_pepper": (0.0, 0.0),
    "dropout": (0.0, 0.0),
}
H, W = 60, 80
RGB = np.full((H, W, 3), 120, np.uint8)
OBJECT = np.zeros((H, W), np.uint32)
OBJECT[20:40, 20:60] = 1
SURFACE = Surface(
    np.ones((H, W), np.float32), np.zeros((H, W), np.float32), np.zeros((H, W), np.float32), OBJECT
)


def noisy(rgb: np.ndarray = RGB, surface: Surface = SURFACE, **values: object) -> np.ndarray:
    settings = NoiseSettings(**{**OFF, **values})  # type: ignore[arg-type]
    return apply_noise(np.random.default_rng(0), rgb, surface, settings)


def test_nothing_asked_nothing_changed() -> None:
    np.testing.assert_array_equal(noisy(), RGB)


def test_gaussian_has_the_deviation_asked_for() -> None:
    off = noisy(gaussian=(4.0, 4.0)).astype(float) - 120
    assert off.std() == pytest.approx(4.0, rel=0.05)
    assert off.mean() == pytest.approx(0.0, abs=0.15)


def test_poisson_has_the_variance_of_counted_photons() -> None:
    # 500 photons make white: 120 / 255 of them give variance n, in steps (255 / 500)^2 n.
    off = noisy(photons=(500.0, 500.0)).astype(float)
    assert off.var() == pytest.approx((255 / 500) ** 2 * 500 * 120 / 255, rel=0.08)
    assert (noisy(np.zeros_like(RGB), photons=(500.0, 500.0)) == 0).all()


def test_salt_and_pepper_hit_the_share_asked_for() -> None:
    out = noisy(salt_pepper=(0.1, 0.1))
    assert (out == 0).all(axis=2).mean() == pytest.approx(0.05, abs=0.02)
    assert (out == 255).all(axis=2).mean() == pytest.approx(0.05, abs=0.02)


def test_dropout_takes_patches_of_the_outline_and_nothing_else() -> None:
    rgb = RGB.copy()
    rgb[OBJECT > 0] = [200, 10, 10]
    out = noisy(rgb, dropout=(0.3, 0.3), dropout_px=2)
    changed = (out != rgb).any(axis=2)
    inner = np.zeros((H, W), bool)
    inner[22:38, 22:58] = True
    edge = (OBJECT > 0) & ~inner
    assert not changed[~edge].any()
    assert changed[edge].mean() == pytest.approx(0.3, abs=0.04)
    assert (out[changed] == 120).all()  # what lies beyond the outline
    # Patches: a lost pixel's neighbour on the outline is mostly lost too.
    top = changed[20, 20:60]
    assert (np.diff(top.astype(int)) != 0).sum() < 0.5 * max(top.sum(), 1) or top.sum() < 3


def test_blur_spreads_a_point_with_the_deviation_asked_for() -> None:
    rgb = np.zeros_like(RGB)
    rgb[30, 40] = 255
    out = noisy(rgb, blur_px=(1.5, 1.5))[..., 0].astype(float)
    rows, columns = np.indices(out.shape)
    assert out.sum() == pytest.approx(255, rel=0.1)  # rounding to bytes
    for places, middle in ((rows, 30), (columns, 40)):
        assert (out * (places - middle) ** 2).sum() / out.sum() == pytest.approx(1.5**2, rel=0.15)


def test_jpeg_loses_more_at_a_lower_quality_and_keeps_the_size() -> None:
    rng = np.random.default_rng(3)
    rgb = np.repeat(rng.integers(0, 255, (H, W, 1)).astype(np.uint8), 3, axis=2)
    error = {
        quality: np.abs(noisy(rgb, jpeg_quality=(quality, quality)).astype(int) - rgb).mean()
        for quality in (10, 50, 95)
    }
    assert error[10] > 1.5 * error[50]
    assert error[50] > 1.5 * error[95] > 0
    assert noisy(rgb, jpeg_quality=(10, 10)).shape == rgb.shape


def test_what_is_not_asked_for_is_not_drawn() -> None:
    plain = NoiseSettings()
    # JPEG comes last and draws last: the noise below it is that of the plain settings.
    before = apply_noise(np.random.default_rng(5), RGB, SURFACE, plain)
    buffer = io.BytesIO()
    Image.fromarray(before).save(buffer, "JPEG", quality=40)
    after = apply_noise(
        np.random.default_rng(5), RGB, SURFACE, plain.replace(jpeg_quality=(40, 40))
    )
    np.testing.assert_array_equal(after, np.asarray(Image.open(buffer)))


def test_an_image_without_an_object_has_no_outline() -> None:
    empty = Surface(SURFACE.depth_m, SURFACE.m0, SURFACE.m1, np.zeros((H, W), np.uint32))
    np.testing.assert_array_equal(noisy(surface=empty, dropout=(0.5, 0.5)), RGB)


def test_noise_follows_from_its_generator_and_leaves_its_inputs_alone() -> None:
    rgb, everything = RGB.copy(), NoiseSettings(dropout=(0.2, 0.2))
    one, two, other = (
        apply_noise(np.random.default_rng(seed), rgb, SURFACE, everything) for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(one, two)
    assert (one != other).any()
    np.testing.assert_array_equal(rgb, RGB)
    assert one.dtype == np.uint8
