"""Pairs of the sheet, and a quick calibration."""

from __future__ import annotations

import pytest

from pliant.models.don import calibration as calibration_module
from pliant.models.don.validation import ValidationPair
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Pair
from tests.models.don.planted import drawn


@pytest.fixture
def few_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Calibration tries few temperatures and radii: which kinds have one of their own is tested."""
    monkeypatch.setattr(calibration_module, "TEMPERATURES", (0.5, 1.0, 4.0))
    monkeypatch.setattr(calibration_module, "MODE_RADII_PX", (4.0,))


@pytest.fixture(scope="session")
def blank_cloths(tmp_path_factory: pytest.TempPathFactory) -> list[Pair]:
    from tests.models.shipped_models import smooth_cloths  # needs the extra `generate`

    return smooth_cloths(tmp_path_factory.mktemp("blank") / "set")


@pytest.fixture(scope="session")
def printed(tmp_path_factory: pytest.TempPathFactory) -> list[Pair]:
    from tests.models.shipped_models import smooth_cloths  # needs the extra `generate`

    return smooth_cloths(tmp_path_factory.mktemp("printed") / "set", variant="printed", design=41)


@pytest.fixture(scope="module")
def pairs(sheet_dataset: Dataset) -> list[ValidationPair]:
    return drawn(sheet_dataset, 8, 60, seed=0)
