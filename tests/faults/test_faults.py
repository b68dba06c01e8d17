"""A few faults of each kind in the default suite; all of them by `python -m tests.faults`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2]


def disturbed(*arguments: object) -> dict[str, dict[str, int]]:
    program = [sys.executable, "-m", "tests.faults", *map(str, arguments)]
    done = subprocess.run(program, cwd=FOLDER, capture_output=True, text=True, timeout=3000)
    assert done.returncode == 0, done.stdout + done.stderr
    found: dict[str, dict[str, int]] = json.loads(Path(arguments[-1]).read_text())  # type: ignore[arg-type]
    return found


def test_a_sample_of_faults(tmp_path: Path) -> None:
    report = tmp_path / "f.json"
    found = disturbed("generate", "--sample", 12, "--json", report)
    assert found["generate"]["tried"] >= 10
    assert found["generate"]["bytes_unseen"] == 0


@pytest.mark.long
@pytest.mark.blender
@pytest.mark.timeout(3600)
def test_a_larger_sample_of_every_command(tmp_path: Path) -> None:
    found = disturbed("--sample", 20, "--json", tmp_path / "f.json")
    assert all(each["tried"] >= 5 for each in found.values())
