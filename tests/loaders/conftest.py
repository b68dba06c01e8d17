from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from pliant.spec.dataset import Dataset

pytest.importorskip("torch", reason="the loaders need the extra 'train'")


def load_sheets() -> ModuleType:
    path = Path(__file__).with_name("sheet_dataset.py")
    spec = importlib.util.spec_from_file_location("sheet_dataset", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def sheets() -> ModuleType:
    return load_sheets()


@pytest.fixture(scope="session")
def sheet_dataset(sheets: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    root = tmp_path_factory.mktemp("sheets") / "set"
    return Dataset.open(sheets.write_sheet_dataset(root, {"train": 4, "val": 2}, symmetric=True))


@pytest.fixture(scope="session")
def sheet_episode(sheets: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    root = tmp_path_factory.mktemp("episode") / "set"
    made = sheets.write_sheet_dataset(root, {"train": 2}, frames=6, temporal=True)
    return Dataset.open(made)
