"""The writers of SPEC.md's walkthrough make valid data, the same in Python and in JavaScript."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pliant.evaluator import check, evaluate
from pliant.spec.dataset import Dataset
from pliant.spec.validation.validate import validate

EXAMPLES = Path(__file__).resolve().parents[2] / "spec" / "examples"


def run(*command: str | Path) -> None:
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("python")
    program = EXAMPLES / "write_dataset.py"
    run(sys.executable, program, folder / "card", folder / "answers.parquet")
    return folder


@pytest.fixture(scope="module")
def javascript(tmp_path_factory: pytest.TempPathFactory) -> Path:
    node = shutil.which("node")
    if node is None or not (EXAMPLES / "node_modules").is_dir():
        pytest.skip("needs node, and npm ci in spec/examples (make venv runs it)")
    folder = tmp_path_factory.mktemp("javascript")
    program = EXAMPLES / "write_dataset.mjs"
    run(node, program, folder / "card", folder / "answers.parquet")
    return folder


@pytest.mark.parametrize("language", ["python", "javascript"])
def test_dataset_and_submission_are_valid(language: str, request: pytest.FixtureRequest) -> None:
    folder = request.getfixturevalue(language)
    report = validate(folder / "card")
    assert [str(issue) for issue in report.issues] == []
    assert check(folder / "answers.parquet", folder / "card") == []
    scores = evaluate(folder / "answers.parquet", folder / "card")
    # Pixels from the image's centre as complex numbers, v up: the card turns and moves by 20 + 4i.
    card = np.array([complex(a, b) for a in (-11.25, 0, 11.25) for b in (-11.25, 0, 11.25)])
    first, second = card * (0.96 + 0.28j), card * (0.28 + 0.96j) + (20 + 4j)
    counted = second.real < 32  # one point leaves the image
    assert counted.sum() == 8
    expected = np.sqrt((np.abs(second - first - 20)[counted] ** 2).mean())
    assert scores.overall["rmse_px"] == pytest.approx(expected, abs=1e-4)


def test_both_languages_write_the_same(python: Path, javascript: Path) -> None:
    tables = sorted(path.relative_to(python) for path in python.rglob("*.parquet"))
    assert len(tables) == 6
    for path in tables:
        one, other = pq.read_table(python / path), pq.read_table(javascript / path)
        assert one.to_pylist() == other.to_pylist(), path
    for index in (0, 1):
        a, b = (Dataset.open(folder / "card")[0][index] for folder in (python, javascript))
        assert a.depth_m is not None
        assert b.depth_m is not None
        np.testing.assert_array_equal(a.rgb, b.rgb)
        np.testing.assert_array_equal(a.depth_m, b.depth_m)
    first, second = (
        json.loads((f / "card/dataset.json").read_text()) for f in (python, javascript)
    )
    assert first == second


def test_the_writers_need_nothing_of_ours() -> None:
    for name in ("write_dataset.py", "write_dataset.mjs"):
        text = (EXAMPLES / name).read_text()
        assert "import pliant" not in text
        assert "from pliant" not in text
