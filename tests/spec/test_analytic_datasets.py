"""Exact data is never refused: random sheets and tubes, with truth in closed form."""

from __future__ import annotations

from pathlib import Path

import pytest

from pliant.spec.validation.validate import validate
from tests.spec.analytic_scenes import write_random_dataset

FEW, MANY = 20, 500


def check(root: Path, seed: int) -> None:
    write_random_dataset(root, seed)
    report = validate(root)
    assert report.counts == {}, (seed, [str(issue) for issue in report.issues[:3]])


# The first ones and some that the rules once refused: thin tubes, tips, edge-on and grazing sheets.
@pytest.mark.parametrize("seed", [*range(FEW - 8), 20, 68, 97, 149, 189, 225, 409, 411])
def test_exact_data_is_valid(tmp_path: Path, seed: int) -> None:
    check(tmp_path, seed)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("first", range(0, MANY, 50))
def test_500_exact_datasets_are_valid(tmp_path: Path, first: int) -> None:
    for seed in range(first, first + 50):
        (tmp_path / str(seed)).mkdir()
        check(tmp_path / str(seed), seed)
