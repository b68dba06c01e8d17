"""Impossible settings of scene, noise and cameras are refused by name, before anything is made."""

from __future__ import annotations

import pytest

from pliant.generator.config import GenerateConfig
from pliant.spec.configuration import settings_from
from pliant.spec.errors import CallError


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("noise.gaussian", {"gaussian": (-1.0, 2.0)}),
        ("noise.salt_pepper", {"salt_pepper": (0.5, 1.5)}),
        ("noise.dropout", {"dropout": (0.4, 0.2)}),
        ("noise.dropout_px", {"dropout_px": 99}),
        ("noise.dropout_scale_px", {"dropout_scale_px": 0.0}),
        ("noise.blur_px", {"blur_px": (-1.0, 2.0)}),
        ("noise.jpeg_quality", {"jpeg_quality": (30, 100)}),
        ("noise.jpeg_quality", {"jpeg_quality": (60, 30)}),
        ("camera.fill", {"fill": (0.5, 1.2)}),
        ("camera.fill", {"fill": (0.9, 0.5)}),
        ("camera.fov_deg", {"fov_deg": (0.0, 40.0)}),
        ("camera.oblique_elevation_deg", {"oblique_elevation_deg": (-10.0, 40.0)}),
        ("camera.distance_m", {"distance_m": (0.0, 1.0)}),
        ("camera.top", {"top": 0.0, "oblique": 0.0}),
        ("camera.shift", {"shift": (0.0, float("nan"))}),
        ("look.sun_elevation_deg", {"sun_elevation_deg": (0.0, 40.0)}),
        ("look.table_value", {"table_value": (0.8, 0.2)}),
        ("look.tables.marble", {"tables": {"marble": 1.0}}),
        ("look.tables", {"tables": {"wood": 0.0}}),
        ("look.rope_colourings.solid", {"rope_colourings": {"solid": -1.0}}),
        ("look.least_contrast", {"least_contrast": 2.0}),
        ("look.materials", {"materials": -1}),
        ("look.first_material", {"first_material": -1}),
        ("depth_camera.table_grey", {"table_grey": (0.0, 150.0)}),
        ("depth_camera.table_grey", {"table_grey": (150.0, 201.0)}),
        ("depth_camera.noise_grey", {"noise_grey": (2.0, 1.0)}),
        ("depth_camera.steepest", {"steepest": (0.0, 1.0)}),
        ("depth_camera.pinholes", {"pinholes": (0.0, 1.5)}),
        ("depth_camera.patch_px", {"patch_px": (0.5, 3.0)}),
        ("depth_camera.specks", {"specks": (float("nan"), 3.0)}),
    ],
)
def test_impossible_settings_are_refused_by_name(field: str, values: dict[str, object]) -> None:
    section = field.partition(".")[0]
    style = "real-depth" if section == "depth_camera" else "raster"
    with pytest.raises(CallError) as refused:
        settings_from(GenerateConfig, {"tiers": ["rope"], "style": style, section: values})
    assert (refused.value.where or "").startswith(field)
