"""A report is written as one: a kill at any step leaves the earlier one, the new one or none."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pliant.evaluator import read_scores
from pliant.spec.errors import SubmissionError


def test_files_of_two_reports_are_refused(scene: Any, tmp_path: Path) -> None:
    reports = scene.reports(tmp_path, {"a": 3.0, "b": 5.0}, protocol="paper")
    for mixed in ("per_pair.parquet", "report.html"):
        folder = tmp_path / mixed
        shutil.copytree(reports / "a", folder)
        shutil.copyfile(reports / "b" / mixed, folder / mixed)
        with pytest.raises(SubmissionError, match=r"not the one that its scores\.json lists"):
            read_scores(folder)
    (reports / "a" / "report.html").unlink()  # the page alone may go
    assert read_scores(reports / "a").method == "a"


TERMINATED = """
import os, signal, sys
from pliant.cli.main import run
from pliant.evaluator import scores
from pliant.spec import limits
place, arguments = sys.argv[1], sys.argv[2:]
wait = limits.subprocess.Popen.wait
def terminate(*args, **kwargs):
    os.kill(os.getpid(), signal.SIGTERM)
def terminate_once(child, *args, **kwargs):
    if child.args[0] == sys.executable:  # libraries start programs of the system
        limits.subprocess.Popen.wait = wait
        terminate()
    return wait(child, *args, **kwargs)
if place == "reading":
    limits.subprocess.Popen.wait = terminate_once
else:
    scores.Scores.write = terminate
sys.exit(run(arguments))
"""


@pytest.mark.parametrize("place", [pytest.param("reading", marks=pytest.mark.long), "writing"])
def test_a_terminated_evaluation_leaves_nothing(place: str, scene: Any, tmp_path: Path) -> None:
    submission = scene.submit(tmp_path / "s.parquet")
    (tmp_path / "temporary").mkdir()
    out = tmp_path / "report"
    command = [sys.executable, "-c", TERMINATED, place, "evaluate", str(submission)]
    done = subprocess.run(
        [*command, "--data", str(scene.root), "--out", str(out)],
        env={**os.environ, "TMPDIR": str(tmp_path / "temporary")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 130, done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["s.parquet", "temporary"]
    assert list((tmp_path / "temporary").iterdir()) == []
