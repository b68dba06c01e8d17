"""A report is written as one: a kill at any step leaves the earlier one, the new one or none."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pliant.evaluator import evaluate, read_scores, write_report
from pliant.spec.errors import SubmissionError

# Writes the report in forked processes; the k-th is killed before its k-th change of a file.
WRITER = """
import os, pickle, signal, sys
from pathlib import Path
from pliant.evaluator.report.report import write_report
scores, earlier, work = pickle.load(open(sys.argv[1], "rb"))
step = 0
while True:
    step += 1
    out = Path(work) / str(step) / "report"
    if (child := os.fork()) == 0:
        left = [step]
        def hook(event, arguments):
            writes = event == "open" and set("wax+") & {*str(arguments[1])}
            if event in ("os.mkdir", "os.rename", "os.remove", "os.rmdir") or writes:
                left[0] -= 1
                if left[0] == 0:
                    os.kill(os.getpid(), signal.SIGKILL)
        write_report(earlier, out)
        sys.addaudithook(hook)
        write_report(scores, out)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if status == 0:
        break
    assert os.WIFSIGNALED(status), status
print(step)
"""


def test_killed_at_any_step_a_report_is_whole_or_not_there(scene: Any, tmp_path: Path) -> None:
    earlier, later = (
        evaluate(
            scene.submit(tmp_path / "s.parquet", scene.table(scene.true_px + off)),
            scene.root,
            protocol="paper",
        )
        for off in (3, 5)
    )
    (tmp_path / "scores").write_bytes(pickle.dumps((later, earlier, str(tmp_path / "killed"))))
    done = subprocess.run(
        [sys.executable, "-c", WRITER, str(tmp_path / "scores")],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    steps = int(done.stdout)
    assert steps > 5
    found = []
    for step in range(1, steps + 1):
        folder = tmp_path / "killed" / str(step) / "report"
        if not folder.exists():
            found.append("none")
            continue
        scores = read_scores(folder)
        expected = {"earlier": earlier, "later": later}
        (name,) = [n for n, each in expected.items() if each.document == scores.document]
        assert scores.per_pair.equals(expected[name].per_pair)
        found.append(name)
    assert found[0] == "earlier"
    assert found[-1] == "later"
    assert found.count("none") <= 1


def test_files_of_two_reports_are_refused(scene: Any, tmp_path: Path) -> None:
    for name, off in (("a", 3), ("b", 5)):
        path = scene.submit(tmp_path / "s.parquet", scene.table(scene.true_px + off))
        write_report(evaluate(path, scene.root, protocol="paper"), tmp_path / name)
    for mixed in ("per_pair.parquet", "report.html"):
        folder = tmp_path / mixed
        shutil.copytree(tmp_path / "a", folder)
        shutil.copyfile(tmp_path / "b" / mixed, folder / mixed)
        with pytest.raises(SubmissionError, match=r"not the one that its scores\.json lists"):
            read_scores(folder)
    (tmp_path / "a" / "report.html").unlink()  # the page alone may go
    assert read_scores(tmp_path / "a").method == "test"


TERMINATED = """
import os, signal, sys
from pliant.cli.main import run
from pliant.evaluator import scores
from pliant.spec import limits
place, arguments = sys.argv[1], sys.argv[2:]
def terminate(*args, **kwargs):
    os.kill(os.getpid(), signal.SIGTERM)
if place == "reading":
    limits.subprocess.Popen.wait = terminate
else:
    scores.Scores.write = terminate
sys.exit(run(arguments))
"""


@pytest.mark.parametrize("place", ["reading", "writing"])
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
