"""Exact data is never refused: random sheets and tubes, with truth in closed form."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from pliant.spec.validation.validate import validate

FEW, MANY = 20, 500


@pytest.fixture(scope="module")
def scenes() -> ModuleType:
    path = Path(__file__).with_name("analytic_scenes.py")
    spec = importlib.util.spec_from_file_location("analytic_scenes", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def check(scenes: ModuleType, root: Path, seed: int) -> None:
    scenes.write_random_dataset(root, seed)
    report = validate(root)
    assert report.counts == {}, (seed, [str(issue) for issue in report.issues[:3]])


# The first ones and some that the rules once refused: thin tubes, tips, edge-on and grazing sheets.
@pytest.mark.parametrize("seed", [*range(FEW - 8), 20, 68, 97, 149, 189, 225, 409, 411])
def test_exact_data_is_valid(scenes: ModuleType, tmp_path: Path, seed: int) -> None:
    check(scenes, tmp_path, seed)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("first", range(0, MANY, 50))
def test_500_exact_datasets_are_valid(scenes: ModuleType, tmp_path: Path, first: int) -> None:
    for seed in range(first, first + 50):
        (tmp_path / str(seed)).mkdir()
        check(scenes, tmp_path / str(seed), seed)
