"""Scripts of `benchmarks/`, which are no package, as modules."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


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
