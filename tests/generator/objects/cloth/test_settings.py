"""What cannot be is refused before anything is simulated, and the field is named."""

from __future__ import annotations

from typing import Any

import pytest

from pliant.generator.objects.cloth import ClothSettings, sample_cloth
from pliant.generator.seeding import RandomStreams, SequenceTask
from pliant.spec.configuration import settings_from
from pliant.spec.errors import CallError


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("tracked_a_side", 34),  # 160 cells do not divide by 33
        ("tracked_a_side", 200),  # more points than the mesh has
        ("thickness_m", 0.2),
        ("coverage_band", (0.4, 0.4)),
        ("contact_spacings", 0.5),
        ("hand_speed_m_s", 3.5),
    ],
)
def test_impossible_settings_are_refused_by_name(field: str, value: Any) -> None:
    with pytest.raises(CallError) as caught:
        settings_from(ClothSettings, {field: value}, "cloth")
    assert caught.value.where == f"cloth.{field}"
    assert field in str(caught.value)
    assert caught.value.exit_code == 2


def test_the_tier_names_the_level_unless_the_settings_do() -> None:
    assert ClothSettings().level_of("cloth-2") == 2
    assert ClothSettings(level=3).level_of("towels") == 3
    assert ClothSettings().band_of(3) == (0.25, 0.42)
    for name in ("cloth", "cloth-4", "cloth-²"):
        with pytest.raises(CallError, match="names no cloth level"):
            sample_cloth(ClothSettings(), RandomStreams(0, SequenceTask(name, "train", 0)))


def test_the_step_is_stable_for_every_size() -> None:
    for points, side_m, ks in ((17, 0.6, 3000.0), (81, 0.6, 3000.0), (129, 2.0, 200.0)):
        settings = ClothSettings(points_a_side=points, side_m=side_m, ks=ks, tracked_a_side=17)
        sheet = settings.sheet()
        assert sheet.ks / sheet.steps_per_second**2 / sheet.mass_kg <= 0.2 + 1e-12
        assert sheet.steps_per_second == 30 * sheet.steps_per_frame
