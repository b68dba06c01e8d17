"""Migration: the stored dataset of 1.0.0 stays readable, and later versions have a road."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from pliant.cli.migrate import command
from pliant.spec.conventions import NEWEST_VERSION
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.reading import sha256_file
from pliant.spec.migrate import STEPS, Step, migrate, migrate_document
from pliant.spec.validation.validate import validate

STORED = Path(__file__).parent / "data" / "dataset-1.0.0"


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    return Path(shutil.copytree(STORED, tmp_path / "stored"))


def contents(root: Path) -> dict[str, bytes]:
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def test_stored_dataset_reaches_the_current_version(stored: Path) -> None:
    """It was written by 1.0.0 and is never written again."""
    migrate(stored)
    assert json.loads((stored / "dataset.json").read_text())["spec_version"] == NEWEST_VERSION
    assert validate(stored).counts == {}
    dataset = Dataset.open(stored)
    assert dataset.sequences[0].correspondences(0).num_rows == 81


def test_nothing_is_done_twice(stored: Path) -> None:
    migrate(stored)
    before = contents(stored)
    again = migrate(stored)
    assert again.files == []
    assert contents(stored) == before
    done = CliRunner().invoke(command, [str(stored)])
    assert "nothing to do" in done.output


def add_rig(document: dict[str, Any]) -> dict[str, Any]:
    return {**document, "rig": "tripod"}


def drop_noise(document: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in document.items() if name != "noise"}


ROAD = (
    Step("1.0.0", "1.1.0", {"cameras": add_rig}),
    Step("1.1.0", "1.2.0", {"sequence": drop_noise, "dataset": lambda d: {**d, "funding": None}}),
)
"""Other changes than those of the real versions, to walk the road they would take."""


def test_steps_are_pure_and_follow_each_other() -> None:
    document = {"spec_version": "1.0.0", "noise": {"gauss": 1}}
    before = json.dumps(document)
    assert migrate_document("sequence", document, ROAD, "1.2.0") == {"spec_version": "1.2.0"}
    assert migrate_document("sequence", document, ROAD, "1.1.0")["noise"] == {"gauss": 1}
    assert json.dumps(document) == before


def test_a_whole_dataset_walks_the_road(stored: Path) -> None:
    done = migrate(stored, ROAD, "1.2.0")
    name = "sequences/cloth-1/cloth-1-train-000000"
    assert (done.found, done.reached) == ("1.0.0", "1.2.0")
    assert done.files == [f"{name}/cameras.json", f"{name}/sequence.json", "dataset.json"]
    info = json.loads((stored / name / "sequence.json").read_text())
    assert "noise" not in info
    listed = {entry["path"]: entry["sha256"] for entry in info["files"]}
    assert listed["cameras.json"] == sha256_file(stored / name / "cameras.json")
    assert json.loads((stored / "dataset.json").read_text())["funding"] is None
    # A validator of today reads the newer minor version, and misses only what 1.0 requires.
    counts = validate(stored).counts
    assert counts == {"SCHEMA_INVALID": 1, "SPEC_VERSION_NEWER": 1}


@pytest.mark.parametrize("stop_at", ["cameras.json", "sequence.json", "dataset.json"])
def test_an_interrupted_migration_goes_on(
    stored: Path, monkeypatch: pytest.MonkeyPatch, stop_at: str
) -> None:
    from pliant.spec import migrate as module

    def interrupted(path: Path, document: Mapping[str, Any]) -> None:
        if path.name == stop_at:
            raise KeyboardInterrupt
        write_json(path, dict(document))

    whole = Path(shutil.copytree(stored, stored.parent / "whole"))
    migrate(whole, ROAD, "1.2.0")
    monkeypatch.setattr(module, "write_json", interrupted)
    with pytest.raises(KeyboardInterrupt):
        migrate(stored, ROAD, "1.2.0")
    monkeypatch.undo()
    migrate(stored, ROAD, "1.2.0")
    assert contents(stored) == contents(whole)


@pytest.mark.parametrize(
    ("version", "says"),
    [("1.7.0", "newer version"), ("2.0.0", "cannot be read"), ("0.9.0", "cannot be read")],
)
def test_what_cannot_be_migrated_says_so(stored: Path, version: str, says: str) -> None:
    path = stored / "dataset.json"
    text = path.read_text()
    path.write_text(text.replace('"spec_version": "1.0.0"', f'"spec_version": "{version}"'))
    with pytest.raises(SpecError, match=says):
        migrate(stored)


def test_a_gap_in_the_road_says_so() -> None:
    with pytest.raises(SpecError, match="no migration is known"):
        migrate_document("dataset", {"spec_version": "1.0.5"}, ROAD, "1.2.0")


def test_shipped_steps_form_one_chain() -> None:
    versions = [step.source for step in STEPS] + [NEWEST_VERSION]
    assert [step.target for step in STEPS] == versions[1:]
