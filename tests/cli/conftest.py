"""A dataset, a submission to it and its report, as the commands make them."""

from __future__ import annotations

from pathlib import Path

import pytest

from pliant.cli.main import run


@pytest.fixture(scope="session")
def scored(tiny_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """`DATA`, `SUB` and `REPORT`: to be read only."""
    folder = tmp_path_factory.mktemp("scored")
    found = {"DATA": tiny_dataset, "SUB": folder / "sub", "REPORT": folder / "report"}
    data, sub = ["--data", str(tiny_dataset)], str(found["SUB"])
    assert run(["predict", "identity", *data, "--out", sub]) == 0
    assert run(["evaluate", sub, *data, "--out", str(found["REPORT"])]) == 0
    return found
