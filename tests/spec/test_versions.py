"""A stored dataset of 1.0.0 stays readable; a newer minor version is read, another major is not."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from pliant.spec.dataset import Dataset
from pliant.spec.io.reading import FileRefusedError
from pliant.spec.validation.validate import validate
from tests.conformance.edits import change_footer, change_json, listed

STORED = Path(__file__).parent / "data" / "dataset-1.0.0"
SEQUENCE = "sequences/cloth-1/cloth-1-train-000000"


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    """Return a copy of what was written once, by 1.0.0."""
    return Path(shutil.copytree(STORED, tmp_path / "stored"))


def rows_of(root: Path) -> int:
    return Dataset.open(root).sequences[0].correspondences(0).num_rows


def test_stored_dataset_is_read(stored: Path) -> None:
    assert validate(stored).counts == {}
    assert rows_of(stored) == 81


def test_newer_minor_version_is_read_without_what_it_added(stored: Path) -> None:
    for name in ("dataset.json", f"{SEQUENCE}/sequence.json", f"{SEQUENCE}/cameras.json"):
        change_json(name, lambda d: d.update(spec_version="1.7.0", funding="none"))(stored)
    change_footer("sequences.parquet", lambda d: d.update(spec_version="1.7.0", funding="none"))(
        stored
    )
    listed()(stored)
    report = validate(stored)
    assert (report.valid, report.counts) == (True, {"SPEC_VERSION_NEWER": 1})
    assert rows_of(stored) == 81


@pytest.mark.parametrize("version", ["2.0.0", "0.9.0", "1.0"])
def test_other_major_version_is_refused(stored: Path, version: str) -> None:
    change_json("dataset.json", lambda d: d.update(spec_version=version))(stored)
    with pytest.raises(FileRefusedError, match=rf"found {version}; required: 1\.x") as refused:
        Dataset.open(stored)
    assert refused.value.code == "SPEC_VERSION_UNSUPPORTED"
    assert set(validate(stored).counts) == {"SPEC_VERSION_UNSUPPORTED"}
