"""Control, bidirectional and surrogate characters: refused in files, escaped in output."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from pliant.cli.main import run
from pliant.evaluator import inspect
from pliant.evaluator.report.leaderboard import render_leaderboard
from pliant.evaluator.report.report import render_report
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.jsonfiles import parse_json
from pliant.spec.text import escaped, shown, unsafe_character
from pliant.spec.validation.issue_codes import make_issue

UNSAFE = {
    "a lone surrogate": "\ud800",
    "the second half of a pair": "\udfff",
    "the start of a terminal command": "\x1b[2J",
    "a carriage return": "\r",
    "delete": "\x7f",
    "a C1 control": "\x9b31m",
    "right-to-left override": "\u202e",
    "right-to-left isolate": "\u2067",
    "Arabic letter mark": "\u061c",
    "a line separator": "\u2028",
}


@pytest.mark.parametrize("text", UNSAFE.values(), ids=UNSAFE)
def test_unsafe_characters_are_found_and_escaped(text: str) -> None:
    assert unsafe_character(f"DON {text}") == text[0]
    assert unsafe_character(f"DON {text}", lines=True) == text[0]
    printed = escaped(f"DON {text}", lines=True)
    assert printed.isascii()
    assert printed.isprintable()
    assert printed.startswith("DON \\")


@pytest.mark.parametrize("text", ["größe", "深度", "علی", "नमस्ते", "🧵", "a\u200db"])
def test_the_scripts_of_the_world_stay_as_they_are(text: str) -> None:
    assert unsafe_character(text) is None
    assert escaped(text) == text


def test_line_feeds_stay_only_where_lines_are_allowed() -> None:
    assert escaped("a\n\tb", lines=True) == "a\n\tb"
    assert escaped("a\n\tb") == "a\\x0a\\x09b"


@pytest.mark.parametrize("text", UNSAFE.values(), ids=UNSAFE)
@pytest.mark.parametrize("document", ["value", "key"])
def test_json_with_unsafe_text_is_refused_with_its_place(text: str, document: str) -> None:
    inner: Any = {"name": text} if document == "value" else {text: 1}
    data = json.dumps({"tiers": [{}, inner]}).encode()
    with pytest.raises(SpecError) as caught:
        parse_json(data, "dataset.json")
    assert "tiers[1]." in str(caught.value)
    assert unsafe_character(str(caught.value)) is None


def test_json_may_have_several_lines_in_a_text() -> None:
    assert parse_json(b'{"description": "a\\n\\tb"}', "x.json") == {"description": "a\n\tb"}


@pytest.mark.parametrize("text", [*UNSAFE.values(), "\n", "\t"])
def test_check_refuses_a_method_name_with_unsafe_characters(
    text: str, scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = scene.submit(tmp_path / "s.parquet", method={"name": f"DON {text}"})
    (issue,) = inspect(path, scene.root).issues()
    assert (issue.code, issue.where) == ("FOOTER_INVALID", "footer method.name")
    assert run(["check", str(path), "--data", str(scene.root)]) == 1
    printed = capsys.readouterr().out
    assert "method.name" in printed
    assert unsafe_character(printed, lines=True) is None
    assert run(["evaluate", str(path), "--data", str(scene.root)]) == 1


def test_a_dataset_with_an_unsafe_name_is_refused(
    scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads((scene.root / "dataset.json").read_text())
    for field in ("id", "title"):
        changed = document | {field: "tiny\u202egnp"}
        (tmp_path / "dataset.json").write_text(json.dumps(changed))
        with pytest.raises(SpecError, match=field):
            Dataset.open(tmp_path)
        assert run(["info", str(tmp_path)]) == 1
        assert "\\u202e" in capsys.readouterr().err


def test_issues_and_errors_are_escaped() -> None:
    issue = make_issue("FILE_MISSING", "a\x1b[2J", "row\u202e", "b\nERROR forged\ud800")
    assert str(issue) == ("ERROR FILE_MISSING a\\x1b[2J [row\\u202e]: b\\x0aERROR forged\\ud800")
    error = SpecError("wrong", path="a\nb", where="c\x07", found="d\r", fix="e\u2066\nf")
    assert str(error) == "a\\x0ab, c\\x07: wrong; found d\\x0d. e\\u2066\nf"


def test_a_file_name_cannot_control_the_terminal(
    scene: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    # The second is no UTF-8: Arrow cannot open it.
    for name, code in ((b"s\x1b[2J.parquet", 0), (b"s\xff.parquet", 1)):
        path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name))
        scene.submit(tmp_path / "s.parquet")
        os.rename(tmp_path / "s.parquet", path)
        assert run(["check", str(path), "--data", str(scene.root)]) == code
        printed = capfd.readouterr().out
        assert ("\\x1b[2J" if b"\x1b" in name else "\\udcff") in printed
        assert unsafe_character(printed, lines=True) is None


def test_pages_escape_names(scene: Any, tmp_path: Path) -> None:
    name = "evil\u202e\ud800<script>"
    scores = scene.score(tmp_path)
    scores.document["submission"]["method"] |= {"name": name, "author": name}
    for page in (render_report(scores), render_leaderboard([scores])):
        page.encode("utf-8")
        assert "evil\\u202e\\ud800&lt;script&gt;" in page
        assert unsafe_character(page, lines=True) is None
        assert page.count("<script") == 5  # its own: four draw the charts


def test_only_plain_text_of_pages_is_escaped() -> None:
    assert shown("a\x1b\n") == "a\\x1b\n"
    assert shown(3.5) == 3.5
