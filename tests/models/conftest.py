from __future__ import annotations

from collections.abc import Iterator

import pytest

from pliant.spec.dataset import Dataset
from tests.loaders.sheet_dataset import write_sheet_dataset

torch = pytest.importorskip("torch", reason="the models need the extra 'train'")


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Small tensors: more threads cost more than they save, and results stay the same."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def sheet_dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    root = tmp_path_factory.mktemp("sheets") / "set"
    return Dataset.open(write_sheet_dataset(root, {"train": 4, "val": 3}, size=(80, 60)))
