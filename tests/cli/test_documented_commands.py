"""The commands of the pages on competitions and imports, run as they stand there."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

import pytest

from pliant.cli.main import run
from pliant.evaluator import evaluate, write_report
from tests.converters.test_import import knots_folder

ROOT = Path(__file__).resolve().parents[2]
TINY = ROOT / "tests" / "data" / "tiny-submission"


def commands(page: str) -> list[list[str]]:
    """Every line of a fenced block that calls Pliant."""
    text = (ROOT / "docs" / page).read_text()
    blocks = re.findall(r"^```(\w*)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    lines = [line for kind, block in blocks if not kind for line in block.splitlines()]
    return [shlex.split(line)[1:] for line in lines if line.startswith("pliant ")]


def test_competition_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(TINY / "dataset", "DATA")
    write_report(evaluate(TINY / "submission.parquet", "DATA"), Path("reports/tiny"))
    codes = {command[0]: run(command) for command in commands("competitions.md")}
    assert codes == {"leaderboard": 0}
    assert Path("site/index.html").is_file()


def test_import_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    knots = {"0": [[[4, 5]], [[10, 6]]], "1": [[[7, 9]], []]}
    knots_folder(Path("SOURCE/images"), knots, frames=2)
    called = commands("import.md")
    assert [command[0] for command in called] == ["import", "validate", "predict", "evaluate"]
    assert [run(command) for command in called] == [0, 0, 0, 0], capsys.readouterr()
    scores = json.loads(Path("report/scores.json").read_text())
    assert scores["overall"]["rmse_px"] == 5  # 3 px to the right and 4 px down, both ways
    # One tier: its figures are those overall, and are not said twice.
    shown = capsys.readouterr().out.splitlines()
    assert [line.split() for line in shown if line.startswith("  RMSE (px)")] == [
        ["RMSE", "(px)", "overall", "5.00"]
    ]
    shutil.copytree("report", "again")
    assert run(["compare", "report", "again"]) == 0
    shown = capsys.readouterr().out.splitlines()
    (line,) = [line for line in shown if line.startswith("RMSE (px)")]
    assert line.startswith("RMSE (px), overall, best first: ")
