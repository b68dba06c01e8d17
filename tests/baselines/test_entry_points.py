"""A method of a package that is installed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import pliant
from pliant.spec.errors import CallError
from tests.baselines.conftest import METHODS_FILE

ROOT = Path(__file__).resolve().parents[2]

PYPROJECT = """
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"

[project]
name = "their-matchers"
version = "2.5"

[project.entry-points."pliant.matchers"]
their-shift = "their_matchers.shift:Shift"

[tool.setuptools]
packages = ["their_matchers"]
"""


@pytest.mark.long
@pytest.mark.slow
def test_package_with_an_entry_point_is_predicted_and_scored(
    tiny_dataset: Path, tmp_path: Path
) -> None:
    """A package that knows nothing but the protocol, installed into an environment of its own."""
    project, home = tmp_path / "project", tmp_path / "environment"
    (project / "their_matchers").mkdir(parents=True)
    (project / "pyproject.toml").write_text(PYPROJECT)
    (project / "their_matchers" / "__init__.py").touch()
    source = METHODS_FILE.replace("import neighbour_of_the_file\n", "")
    (project / "their_matchers" / "shift.py").write_text(source)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home], check=True)
    python = home / "bin" / "python"
    packages = next((home / "lib").glob("python3.*/site-packages"))
    ours = [path for path in sys.path if path.endswith("site-packages")]
    (packages / "dependencies.pth").write_text("\n".join(ours))
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PIP_NO_INDEX": "1"}
    shell: Callable[..., str] = lambda *command: subprocess.run(  # noqa: E731
        [str(word) for word in command],
        env=environment, cwd=tmp_path, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    shell(
        *(sys.executable, "-m", "pip", "--python", python, "install", "-q"),
        *("--no-deps", "--no-build-isolation", project),
    )
    program = (python, "-c", "from pliant.cli.main import main; main()")
    listed = shell(*program, "methods")
    assert "their-shift" in listed
    assert "Plug-in their_matchers.shift:Shift of their-matchers 2.5" in listed
    arguments = ("--data", tiny_dataset, "--out", "out.parquet", "--set", "du=7", "--set", "dv=7")
    said = json.loads(shell(*program, "predict", "their-shift", *arguments, "--json"))
    assert said["method"]["name"] == "their-shift"
    scores = pliant.evaluate(tiny_dataset, tmp_path / "out.parquet")
    identity = pliant.evaluate(
        tiny_dataset, pliant.predict(tiny_dataset, "identity").answers.uv_px + 7
    )
    assert scores.overall == identity.overall
    with pytest.raises(CallError, match="no method 'their-shift'"):
        pliant.open_method("their-shift")  # this environment does not have it
