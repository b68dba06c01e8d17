"""An import that is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import Refused

Rejected = Callable[..., str]


@pytest.fixture
def rejected(refused: Refused, tmp_path: Path) -> Rejected:
    """A function: source, options, exit code -> what is said; nothing may be written."""

    def call(source: Path, *options: object, code: int = 1) -> str:
        before = sorted(tmp_path.rglob("*"))
        said = refused(code, "import", source, "--out", tmp_path / "no", *options)
        assert sorted(tmp_path.rglob("*")) == before
        return said

    return call
