"""The conformance suite's datasets, as the spec's tests use them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

DATASETS = Path(__file__).resolve().parents[2] / "spec" / "conformance" / "datasets"


@pytest.fixture
def copy_of(tmp_path: Path) -> Callable[[str], Path]:
    """Return a function that copies a base dataset of the conformance suite to a fresh place."""

    def copy(name: str) -> Path:
        return Path(shutil.copytree(DATASETS / name, tmp_path / name))

    return copy
