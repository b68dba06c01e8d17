"""SPEC.md and its annexes are what the code declares, and their examples hold."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from pliant.spec.conventions import CONVENTIONS
from pliant.spec.io.jsonfiles import load_schema, parse_json, schema_errors
from pliant.spec.tables import TABLES
from pliant.spec.validation.issue_codes import ISSUE_CODES
from tests import spec_document as document

TEXTS = {path: path.read_text(encoding="utf-8") for path in document.TEXTS}
TEXT = "\n".join(TEXTS.values())
SPEC = Path(__file__).resolve().parents[2] / "spec"


def test_generated_parts_are_fresh() -> None:
    assert document.stale() == []
    assert document.render(TEXT) == TEXT


def test_a_stale_part_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = tmp_path / "SPEC.md"
    path.write_text(TEXT.replace("| `m0` | float32 |", "| `m0` | float64 |"))
    monkeypatch.setattr(document, "TEXTS", (path,))
    assert document.stale() == ["table points"]
    path.write_text(TEXT.replace("| 1 | 2 | 65.95 |", "| 1 | 2 | 65.59 |"))
    assert document.stale() == ["rows correspondences"]
    part = re.compile(r"<!-- generated: schema cameras -->.*?<!-- end -->", re.DOTALL)
    path.write_text(part.sub("", TEXT))
    assert document.stale() == ["schema cameras"]


BLOCKS = re.findall(r"^```(\w+) ?([\w-]*)\n(.*?)^```$", TEXT, flags=re.M | re.S)


def test_every_block_is_of_a_kind_that_is_tested() -> None:
    kinds = {(language, bool(name)) for language, name, _ in BLOCKS}
    assert kinds == {("json", True), ("python", False), ("text", False), ("sh", False)}
    named = {name for language, name, _ in BLOCKS if language == "json"}
    assert named == {"dataset", "sequence", "cameras", "manifest", "footer-truth", "footer-answers"}


@pytest.mark.parametrize(("language", "name", "text"), [b for b in BLOCKS if b[0] == "json"])
def test_json_examples_satisfy_their_schemas(language: str, name: str, text: str) -> None:
    example = parse_json(text.encode(), "SPEC.md")
    assert list(schema_errors(example, name)) == []


@pytest.mark.parametrize("text", [b[2] for b in BLOCKS if b[0] == "python"])
def test_python_examples_run(text: str) -> None:
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_every_code_has_a_remedy() -> None:
    assert all(code.cause and code.remedy for code in ISSUE_CODES.values())


def test_codes_in_the_text_are_in_the_catalogue() -> None:
    known = set(ISSUE_CODES)
    for word in re.findall(r"`([A-Z]+_[A-Z_]+)`", TEXT):
        assert word in known, word


@pytest.mark.parametrize("name", document.JSON_SCHEMAS)
def test_schemas_are_schemas(name: str) -> None:
    schema = load_schema(name)
    Draft202012Validator.check_schema(schema)
    assert schema["$id"].endswith(name)


def test_schema_files_are_all_listed() -> None:
    folder = SPEC / "schemas" / "1.0.0"
    assert {path.name for path in folder.iterdir()} == {
        *(f"{name}.schema.json" for name in document.JSON_SCHEMAS),
        *(f"{name}.arrow" for name in TABLES),
        "answers-optional.arrow",
        "tables.json",
        "issue_codes.json",
    }


def test_schema_and_code_have_the_same_conventions() -> None:
    properties = load_schema("dataset")["properties"]["conventions"]["properties"]
    assert {name: entry["const"] for name, entry in properties.items()} == CONVENTIONS


def test_links_of_the_text_lead_somewhere() -> None:
    for path, text in TEXTS.items():  # headings: tests/docs/test_links.py
        for target in re.findall(r"\[[^\]|]+\]\(([\w./]+)\)", text):
            assert (path.parent / target).exists(), target


def test_the_core_is_short() -> None:
    assert len(TEXTS[SPEC / "SPEC.md"].split()) <= 3000


def test_example_reader_imports_nothing_of_ours() -> None:
    script = SPEC / "examples" / "read_without_pliant.py"
    code = f"import sys, runpy; sys.argv = ['x', {str(SPEC / 'conformance/datasets/full')!r}]\n"
    code += f"runpy.run_path({str(script)!r}, run_name='__main__')\n"
    code += "assert not [m for m in sys.modules if m.split('.')[0] == 'pliant']\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 6
    assert lines[-1] == "test: 15 queries"
    for line in lines[:-1]:
        error_px = float(re.search(r"within ([\d.]+) px", line)[1])  # type: ignore[index]
        assert error_px < 0.01
