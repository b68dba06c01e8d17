"""The tutorial's commands and its script, run in their order with smaller numbers."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest

from pliant.cli.main import run

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "tutorial.md").read_text()
EXAMPLE = ROOT / "docs" / "examples" / "nearest_colour.py"

SMALLER = {
    "pliant generate rope": "pliant generate rope --style raster --workers 1",
    "train=24,val=4,test=4": "train=2,val=1,test=2",
    "--frames 3": "--frames 2",
    "320x240": "160x120",
    "steps=150": "steps=2",
    "validation.every=50": "validation.every=2",
    "validation.pairs=8": "validation.pairs=2",
    "validation.calibration_pairs=12": "validation.calibration_pairs=2",
}
SHOWN_ELSEWHERE = {"demo"}  # tests/cli/test_demo.py


def test_the_page_shows_the_example() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    program = EXAMPLE.read_text()
    assert program.endswith(code)
    assert not re.search(r"(import|from) pliant", program)


@pytest.mark.long
@pytest.mark.usefixtures("quick_tracing")
def test_the_tour(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("numba")
    pytest.importorskip("torch")
    pytest.importorskip("cv2")
    monkeypatch.chdir(tmp_path)
    text = PAGE
    for shown, smaller in SMALLER.items():
        assert shown in text, f"the page no longer shows {shown}: set it small here too"
        text = text.replace(shown, smaller)
    called = []
    for kind, block in re.findall(r"^```(\w*)\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        for line in re.sub(r"\\\n\s*", " ", block).splitlines():
            words = shlex.split(line, comments=True) if kind in ("", "sh") else []
            if words[:1] == ["pliant"] and words[1] not in SHOWN_ELSEWHERE:
                assert run(words[1:]) == 0, (line, capsys.readouterr().err)
                called.append(words[1])
            elif words[:1] == ["python"]:
                assert words[1] == f"pliant/{EXAMPLE.relative_to(ROOT)}"
                monkeypatch.setattr(sys, "argv", words[1:])
                runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert set(called) == {
        "generate", "info", "validate", "view", "predict", "submission", "train", "check",
        "evaluate", "compare", "leaderboard", "publish",
    }  # fmt: skip
    scores = [
        json.loads(Path(folder, "don/scores.json").read_text())
        for folder in ("reports", "reports-private")
    ]
    assert scores[0]["overall"] == scores[1]["overall"]  # as the page says
    assert Path("board.html").is_file()
    assert Path("sheet.jpg").is_file()
