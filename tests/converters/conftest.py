"""An import that is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from pliant.cli.main import run

Refused = Callable[..., str]


@pytest.fixture
def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Refused:
    """A function: source, options, exit code -> what is said; nothing may be written."""

    def call(source: Path, *options: str, code: int = 1) -> str:
        before = sorted(tmp_path.rglob("*"))
        capsys.readouterr()
        assert run(["import", str(source), "--out", str(tmp_path / "no"), *options]) == code
        assert sorted(tmp_path.rglob("*")) == before
        return capsys.readouterr().err

    return call
