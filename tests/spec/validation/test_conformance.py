"""Every case of the conformance suite gives exactly its codes, from the shipped files."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from _pytest.mark import ParameterSet

from pliant.spec.validation.issue_codes import ISSUE_CODES
from pliant.spec.validation.validate import validate
from tests.conformance import build

INDEX = json.loads(build.INDEX.read_text())
ENTRIES: list[dict[str, Any]] = INDEX["datasets"]


def cases() -> Iterator[ParameterSet]:
    """Yield every case; `make test` has the first one of each code and the valid bases."""
    seen: set[str] = set()
    for entry in ENTRIES:
        new = set(entry["codes"] or [entry["base"]]) - seen
        seen |= new
        yield pytest.param(entry, id=entry["name"], marks=[] if new else [pytest.mark.long])


@pytest.fixture(scope="module")
def archive() -> Iterator[zipfile.ZipFile]:
    with zipfile.ZipFile(build.FILES) as opened:
        yield opened


@pytest.mark.parametrize("entry", list(cases()))
def test_case(entry: dict[str, Any], archive: zipfile.ZipFile, tmp_path: Path) -> None:
    build.apply(entry, archive, tmp_path / "dataset")
    report = validate(tmp_path / "dataset")
    assert sorted(report.counts) == entry["codes"], [str(issue) for issue in report.issues]
    severities = {ISSUE_CODES[code].severity for code in entry["codes"]}
    assert report.valid is ("error" not in severities)


def test_the_suite_is_what_its_source_says() -> None:
    shipped = {entry["name"]: (entry["base"], entry["codes"]) for entry in ENTRIES}
    assert len(shipped) == len(ENTRIES)
    assert shipped == {case["name"]: (case["base"], sorted(case["codes"])) for case in build.CASES}
    invalid = [case for case in build.CASES if case["codes"]]
    assert len(invalid) >= 60
    assert len({case["change"] for case in invalid}) == len(invalid)


def test_every_dataset_code_is_given_by_some_case() -> None:
    given = {code for entry in ENTRIES for code in entry["codes"]}
    expected = {code.code for code in ISSUE_CODES.values() if code.subject != "submission"}
    # MODES_INVALID and the like belong to submissions; every other code must have a case.
    assert expected - given == set()


def test_the_cases_are_small() -> None:
    size = build.FILES.stat().st_size
    size += sum(path.stat().st_size for path in build.DATASETS.rglob("*") if path.is_file())
    assert size < 3 * 2**20


SUBMISSIONS = json.loads(build.SUBMISSIONS_INDEX.read_text())["submissions"]


@pytest.mark.parametrize("entry", SUBMISSIONS, ids=lambda entry: entry["name"])
def test_submission(entry: dict[str, Any]) -> None:
    from pliant.evaluator import check

    issues = check(build.SUBMISSIONS / entry["name"], build.DATASETS / "full")
    assert sorted({issue.code for issue in issues}) == entry["codes"], issues
