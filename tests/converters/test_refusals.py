"""A broken source is refused in one sentence that names the place, and nothing is written."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from pliant.cli.main import run
from pliant.spec.io.yamlfiles import read_yaml
from tests.conformance.edits import change_document
from tests.converters.conftest import Rejected
from tests.converters.test_annotation_tools import coco
from tests.converters.test_import import KNOTS, knots_folder
from tests.converters.test_pictures import CSV, photographs

CASES: list[dict[str, Any]] = read_yaml(Path(__file__).with_name("refusals.yaml"))


def written(folder: Path, of: str, **changes: Any) -> Path:
    """Write a source with some changes."""
    if of == "knots":
        knots = deepcopy(KNOTS)
        change_document(knots, **changes)
        return knots_folder(folder, knots)
    photographs(folder)
    if of == "coco":
        document = coco()
        change_document(document, **changes)
        (folder / "export.json").write_text(json.dumps(document))
        return folder
    if "old" in changes:
        assert changes["old"] in CSV
        changes["text"] = CSV.replace(changes["old"], changes["new"])
    (folder / "annotations.csv").write_text(changes["text"])
    return folder


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['of']}: {case['name']}")
def test_what_is_broken_is_refused(
    case: dict[str, Any], tmp_path: Path, rejected: Rejected
) -> None:
    changes = {key: value for key, value in case.items() if key not in ("name", "says")}
    assert case["says"] in rejected(written(tmp_path / "source", **changes))


def test_a_number_or_a_field_without_end(tmp_path: Path, rejected: Rejected) -> None:
    document = coco()
    document["annotations"][1]["keypoints"][0] = 10**400
    folder = photographs(tmp_path / "coco")
    (folder / "export.json").write_text(json.dumps(document))
    long = written(tmp_path / "csv", "csv", old="ball,4.5", new="b" * 200_000 + ",4.5")
    assert "annotations[1].keypoints[0]: a field" in rejected(folder)
    assert "line 2: the line" in rejected(long)


def test_a_folder_whose_name_is_no_id_needs_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = written(tmp_path / "source", "coco")
    assert run(["import", str(source), "--out", str(tmp_path / "a b")]) == 2
    said = capsys.readouterr().err
    assert "found 'a b'; required: 1 to 128 letters" in said
    assert "Name the dataset with --id" in said
    assert run(["import", str(source), "--out", str(tmp_path / "a b"), "--id", "a-b"]) == 0
