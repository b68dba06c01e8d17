"""Scripts of `benchmarks/`, which are no package, as modules."""

from __future__ import annotations

import importlib.util
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
THUMB = Path(__file__).parent / "thumb.yaml"
"""A benchmark of everything, made in seconds."""


@pytest.fixture(scope="module")
def config_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copy(THUMB, tmp_path_factory.mktemp("config")))


@contextmanager
def script(name: str) -> Iterator[ModuleType]:
    """Import `benchmarks/NAME.py`, without leaving its folder on the path."""
    names = ("record", name)
    for each in names:
        spec = importlib.util.spec_from_file_location(each, BENCHMARKS / f"{each}.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[each] = module
        spec.loader.exec_module(module)
    yield sys.modules[name]
    for each in names:
        del sys.modules[each]
