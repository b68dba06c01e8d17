from __future__ import annotations

import dataclasses
import math
from colorsys import rgb_to_hsv
from typing import Any

import numpy as np
import pytest

from pliant.generator.rendering.materials import (
    cloth_images,
    fibre_places,
    table_reflectance,
    value_noise,
)
from pliant.generator.scene.appearance import Appearance, sample_appearance
from pliant.generator.scene.scene_object import SceneObject
from pliant.generator.settings.scene import AppearanceSettings
from pliant.spec.errors import CallError
from tests.generator.world import srgb_curve


def appearance_of(scene_object: SceneObject, seed: int = 0, **values: Any) -> Appearance:
    return sample_appearance(
        np.random.default_rng(seed), scene_object, AppearanceSettings(**values)
    )


@pytest.mark.parametrize("seed", range(12))
def test_colours_stand_out_and_light_is_what_was_asked(sheet: SceneObject, seed: int) -> None:
    appearance = appearance_of(sheet, seed, brightness=(0.8, 0.8), sun_share=(0.7, 0.7))
    srgb = srgb_curve(np.array([appearance.table.colour, appearance.cloth_colours[0]]))
    assert math.dist(*srgb) >= AppearanceSettings().least_contrast - 1e-9
    sun = np.mean(appearance.light.sun_irradiance) * appearance.light.sun_direction[2] / math.pi
    assert sun == pytest.approx(0.7 * 0.8)
    assert np.mean(appearance.light.sky_radiance) == pytest.approx(0.3 * 0.8)
    assert np.linalg.norm(appearance.light.sun_direction) == pytest.approx(1.0)


def test_odd_strands_are_kept_by_the_reversal(tube: SceneObject) -> None:
    """Strand k becomes -k."""
    for count in (3, 4, 6):
        part = dataclasses.replace(
            tube.parts[0], strand=np.arange(len(tube.parts[0].rest), dtype=np.int32) % count
        )
        scene_object = dataclasses.replace(tube, parts=(part,))
        for seed in range(6):
            colours = appearance_of(scene_object, seed).strand_colours
            assert len(colours) == count
            assert all(colours[k] == colours[-k % count] for k in range(count))


def test_fibres_are_the_same_on_a_reversed_rope(tube: SceneObject) -> None:
    rest = tube.parts[0].rest
    length = rest[:, 0].max()
    reversed_rest = np.stack([length - rest[:, 0], rest[:, 1], -rest[:, 2]], axis=1)
    np.testing.assert_allclose(fibre_places(reversed_rest), fibre_places(rest), atol=1e-12)


def test_a_plain_cloth_looks_the_same_under_the_eight_maps(sheet: SceneObject) -> None:
    front, back = cloth_images(appearance_of(sheet), width=480)
    np.testing.assert_array_equal(front, back)
    for turned in (front[::-1], front[:, ::-1], np.swapaxes(front, 0, 1), np.rot90(front)):
        np.testing.assert_allclose(turned, front, atol=1e-6)
    assert np.ptp(front[..., 0]) > 0  # there is a weave at all


@pytest.mark.parametrize("kind", ["plain", "mottled", "wood"])
def test_a_table_keeps_its_mean_colour(sheet: SceneObject, kind: str) -> None:
    table = dataclasses.replace(appearance_of(sheet).table, kind=kind, contrast=0.5)
    xy = np.random.default_rng(0).uniform(-2, 2, (4000, 2))
    colours = table_reflectance(table, xy)
    np.testing.assert_allclose(colours.mean(axis=0), table.colour, rtol=0.1)
    assert colours.min() >= 0
    assert colours.max() <= 0.95
    assert (colours.std(axis=0).max() > 1e-3) == (kind != "plain")


def test_value_noise_is_continuous_across_its_lattice() -> None:
    at = [value_noise(3.0 + d, -2.0 + d, 0.5) for d in (-1e-7, 0.0, 1e-7)]
    assert max(at) - min(at) < 1e-5
    many = np.array([value_noise(0.37 * k, 0.11 * k, 0.77 * k) for k in range(2000)])
    assert many.min() >= 0
    assert many.max() <= 1
    assert many.mean() == pytest.approx(0.5, abs=0.03)


def test_colours_that_cannot_stand_out_are_refused(sheet: SceneObject) -> None:
    grey = {"table_value": (0.5, 0.5), "table_saturation": (0.0, 0.0)}
    same = {"object_value": (0.5, 0.5), "object_saturation": (0.0, 0.0)}
    with pytest.raises(CallError, match=r"look\.least_contrast"):
        appearance_of(sheet, 0, **grey, **same)


def test_colours_of_the_object_that_cannot_differ_are_refused(sheet: SceneObject) -> None:
    settings = AppearanceSettings(
        least_contrast=0.5, table_value=(0.9, 0.95), object_value=(0.1, 0.3)
    )
    with pytest.raises(CallError, match="with another colour of the object"):
        sample_appearance(np.random.default_rng(0), sheet, settings)


def test_materials_stay_in_their_family_of_hues(sheet: SceneObject) -> None:
    """Red to cyan over the origin of the circle, without the quarter from cyan to violet."""
    values = {"object_hue": (-0.25, 0.5), "object_saturation": (0.5, 0.9)}
    hues = []
    for seed in range(40):
        colours = np.array(appearance_of(sheet, seed, **values).cloth_colours)
        hues += [rgb_to_hsv(*colour)[0] for colour in srgb_curve(colours)]
    kept_out = (np.array(hues) > 0.501) & (np.array(hues) < 0.749)
    assert not kept_out.any()
    assert min(hues) < 0.1
    assert max(hues) > 0.9
