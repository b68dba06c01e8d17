from __future__ import annotations

import pytest

from pliant.spec.dataset import Dataset
from tests.loaders.sheet_dataset import write_sheet_dataset

pytest.importorskip("torch", reason="the loaders need the extra 'train'")


@pytest.fixture(scope="session")
def sheet_dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    root = tmp_path_factory.mktemp("sheets") / "set"
    return Dataset.open(write_sheet_dataset(root, {"train": 4, "val": 2}, symmetric=True))


@pytest.fixture(scope="session")
def sheet_episode(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    root = tmp_path_factory.mktemp("episode") / "set"
    return Dataset.open(write_sheet_dataset(root, {"train": 2}, frames=6, temporal=True))
