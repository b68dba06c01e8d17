"""The notebooks of the documentation run from top to bottom."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import pytest

NOTEBOOKS = Path(__file__).resolve().parents[2] / "docs" / "notebooks"


def executed(name: str, folder: Path) -> str:
    """Return what the cells of a notebook print, one text."""
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    book = nbformat.read(NOTEBOOKS / name, as_version=4)
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    resources = {"metadata": {"path": str(folder)}}
    nbclient.NotebookClient(book, timeout=600, kernel_name="python3", resources=resources).execute()
    outputs: list[Any] = [each for cell in book.cells for each in cell.get("outputs", ())]
    assert any("image/png" in each.get("data", {}) for each in outputs)
    return "".join(each.get("text", "") for each in outputs)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(900)
def test_quickstart(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    lines = executed("quickstart.ipynb", tmp_path).splitlines()
    names = [line.split()[0] for line in lines if "RMSE" in line]
    assert names == ["identity", "same_fraction", "sift"]


@pytest.mark.long
@pytest.mark.timeout(900)
def test_train(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    text = executed("train.ipynb", tmp_path)
    assert [line.split()[0] for line in text.splitlines() if "PCK 8 px" in line] == [
        "tiny",
        "random",
    ]
    assert (tmp_path / "runs" / "tiny" / "report.html").is_file()
