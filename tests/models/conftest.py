from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from pliant.spec.dataset import Dataset

torch = pytest.importorskip("torch", reason="the models need the extra 'train'")


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Small tensors: more threads cost more than they save, and results stay the same."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def sheets() -> ModuleType:
    path = Path(__file__).parents[1] / "loaders" / "sheet_dataset.py"
    spec = importlib.util.spec_from_file_location("sheet_dataset", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def sheet_dataset(sheets: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    root = tmp_path_factory.mktemp("sheets") / "set"
    return Dataset.open(sheets.write_sheet_dataset(root, {"train": 4, "val": 3}, size=(80, 60)))
