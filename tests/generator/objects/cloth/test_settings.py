"""What cannot be is refused before anything is simulated, and the field is named."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.course_scene import parse_scene, read_scene
from pliant.generator.objects.cloth import ClothSettings, sample_cloth
from pliant.generator.seeding import RandomStreams, SequenceTask
from pliant.spec.errors import CallError


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("level", 4),
        ("level", True),
        ("variant", "tartan"),
        ("side_m", 0.0),
        ("side_m", math.nan),
        ("side_m", "0.6"),
        ("points_a_side", 4),
        ("points_a_side", 81.0),
        ("doublings", 9),
        ("smoothing", 1.5),
        ("tracked_a_side", 34),  # 160 cells do not divide by 33
        ("tracked_a_side", 200),  # more points than the mesh has
        ("thickness_m", 0.2),
        ("contact_spacings", 0.5),
        ("density", -1.0),
        ("ks", math.inf),
        ("bending_ratio", 2.0),
        ("damping_percent", -0.1),
        ("cloth_friction", 9.0),
        ("table_friction", math.nan),
        ("hand_speed_m_s", 3.5),
        ("coverage_band", (0.6, 0.4)),
        ("coverage_band", (0.2, 0.4, 0.6)),
        ("yaw_max_rad", 4.0),
        ("max_tries", 0),
    ],
)
def test_impossible_settings_are_refused_by_name(field: str, value: Any) -> None:
    with pytest.raises(CallError) as caught:
        ClothSettings(**{field: value})
    assert caught.value.where == f"cloth.{field}"
    assert field in str(caught.value)
    assert caught.value.exit_code == 2


def test_a_list_from_a_file_is_a_band() -> None:
    assert ClothSettings(coverage_band=[0.3, 0.5]).coverage_band == (0.3, 0.5)  # type: ignore[arg-type]


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


GOOD: dict[str, Any] = {
    "cloth": {"width": 1, "height": 1, "num_width_points": 5, "num_height_points": 4},
    "sphere": {"origin": [0, 0, 0], "radius": 0.5, "friction": 0.3},
}


def changed(path: str, value: Any) -> dict[str, Any]:
    document = json.loads(json.dumps(GOOD))
    *folders, leaf = path.split(".")
    place = document
    for folder in folders:
        place = place.setdefault(folder, {})
    if value is KeyError:
        del place[leaf]
    else:
        place[leaf] = value
    return document


@pytest.mark.parametrize(
    ("path", "value", "where"),
    [
        ("cloth", KeyError, "cloth"),
        ("cloth.width", KeyError, "cloth.width"),
        ("cloth.width", -1, "cloth.width"),
        ("cloth.num_width_points", 5.5, "cloth.num_width_points"),
        ("cloth.num_height_points", 10**9, "cloth.num_height_points"),
        ("cloth.orientation", 2, "cloth.orientation"),
        ("cloth.pinned", [[5, 0]], "cloth.pinned[0]"),
        ("cloth.pinned", [[0, 0], [0, 4]], "cloth.pinned[1]"),
        ("cloth.pinned", [[0]], "cloth.pinned[0]"),
        ("cloth.enable_bending_constraints", "yes", "cloth.enable_bending_constraints"),
        ("cloth.damping", 101, "cloth.damping"),
        ("cloth.colour", "red", "cloth"),
        ("sphere.radius", 0, "sphere.radius"),
        ("sphere.origin", [0, 0], "sphere.origin"),
        ("plane", {"point": [0, 0, 0], "normal": [0, 0, 0]}, "plane.normal"),
        ("plane", [], "plane"),
        ("wind", {}, ""),
    ],
)
def test_a_scene_that_cannot_be_is_refused_by_field(path: str, value: Any, where: str) -> None:
    with pytest.raises(CallError) as caught:
        parse_scene(changed(path, value), "scene.json")
    assert (caught.value.where or "") == where
    assert "scene.json" in str(caught.value)


def test_a_scene_is_placed_as_in_the_course() -> None:
    document = changed("cloth.pinned", [[0, 0], [4, 3]])
    scene = parse_scene(document, "x")
    assert scene.positions.shape == (20, 3)
    np.testing.assert_allclose(scene.positions[[0, 4, 15]], [[0, 1, 0], [1, 1, 0], [0, 1, 1]])
    assert np.flatnonzero(scene.pinned).tolist() == [0, 19]  # [column, row]
    upright = parse_scene(changed("cloth.orientation", 1), "x")
    np.testing.assert_allclose(upright.positions[[0, 4, 15], :2], [[0, 0], [1, 0], [0, 1]])
    assert 0 < np.abs(upright.positions[:, 2]).max() <= 1e-3


def test_scene_files(tmp_path: Path) -> None:
    good = tmp_path / "mine.json"
    good.write_text(json.dumps(GOOD))
    assert len(read_scene(good).positions) == 20
    bad = tmp_path / "bad.json"
    bad.write_text("{")
    with pytest.raises(CallError, match="not JSON"):
        read_scene(bad)
    with pytest.raises(CallError, match=r"cannot be read.*pinned2"):
        read_scene(tmp_path / "none.json")
