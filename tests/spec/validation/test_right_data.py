"""No generated sequence is refused, and hardly one is doubted, of any tier and style."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pliant.spec.validation.validate import validate

ROPES: dict[str, Any] = {"tiers": ("rope",), "frames": 1, "width": 160, "height": 120, "seed": 2}
CLOTHS: dict[str, Any] = {**ROPES, "tiers": ("cloth-1", "cloth-2", "cloth-3"), "frames": 2}
EVERY: dict[str, Any] = {**CLOTHS, "tiers": ("rope", "cloth-1", "cloth-2", "cloth-3", "towel")}

SETS: dict[str, tuple[int, dict[str, Any]]] = {
    "ropes-64x48": (90, {**ROPES, "width": 64, "height": 48, "seed": 1}),
    "ropes-160x120": (100, ROPES),
    "ropes-320x240": (100, {**ROPES, "width": 320, "height": 240, "seed": 5}),
    "cloths-160x120": (20, {**CLOTHS, "seed": 3}),
    "cloths-320x240": (10, {**CLOTHS, "width": 320, "height": 240, "seed": 10}),
    "episodes": (10, {**EVERY, "frames": 5, "episodes": True, "seed": 4}),
    "noise": (5, {**EVERY, "noise": {}, "seed": 9}),
    "fast": (4, {**EVERY, "style": "fast", "seed": 6}),
    "photo": (3, {**EVERY, "style": "photo", "seed": 8}),
    "real-depth": (2, {**EVERY, "style": "real-depth", "seed": 9}),
}
"""Name -> (sequences of each tier, settings): 500 sequences in all."""


def found_in(out: Path, count: int, changes: dict[str, Any]) -> tuple[int, list[str], list[str]]:
    """Generate a set and return (sequences, errors, warnings)."""
    style = changes.get("style", "raster")
    for name in ("numba", "psutil", "bpy" if style in ("fast", "photo") else "numba"):
        pytest.importorskip(name)
    from pliant.generator.config import GenerateConfig
    from pliant.generator.runner.run import generate
    from pliant.generator.settings.cloth import ClothSettings
    from tests.generator.runner.standin import InProcess

    config = GenerateConfig(
        splits={"train": count},
        cloth=ClothSettings(points_a_side=33, tracked_a_side=17),
        **{**changes, "style": style},
    )
    here = style == "raster" and count < 20
    generate(config, out, workers=2, engine=InProcess() if here else "local")
    report = validate(out)
    errors = [str(issue) for issue in report.issues if issue.severity == "error"]
    warnings = [str(issue) for issue in report.issues if issue.severity == "warning"]
    return report.sequences, errors, warnings


@pytest.mark.long
def test_ropes_with_dark_outlines_are_not_refused(tmp_path: Path) -> None:
    """In the last of these one-frame ropes a line inside it has more contrast than its outline."""
    count, errors, warnings = found_in(tmp_path / "set", 12, ROPES)
    assert (count, errors, warnings) == (12, [], [])


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_five_hundred_sequences(tmp_path: Path) -> None:
    total = 0
    doubted: list[str] = []
    for name, (count, changes) in SETS.items():
        sequences, errors, warnings = found_in(tmp_path / name, count, changes)
        assert errors == [], name
        total += sequences
        doubted += warnings
    assert total >= 500
    assert len(doubted) <= 0.01 * total, doubted
