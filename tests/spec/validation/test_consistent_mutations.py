"""Errors that leave every file in order by itself, on a rendered set: each one is reported.

A mutation changes all files that follow from one another, as a program with that error would: a
shifted principal point moves u_px, v_px too. Queries and truth, which would give it away, are left
out.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from _pytest.mark import ParameterSet

from pliant.spec.io.yamlfiles import read_yaml
from pliant.spec.validation.validate import Report, validate
from tests.conformance.edits import change_json, change_rows, listed
from tests.conformance.steps import perform

MUTATIONS: list[dict[str, Any]] = read_yaml(Path(__file__).with_name("mutations.yaml"))


@pytest.fixture
def copy(rendered_dataset: Path, tmp_path: Path) -> Path:
    ignored = shutil.ignore_patterns("queries", "truth", ".*")
    return Path(shutil.copytree(rendered_dataset, tmp_path / "set", ignore=ignored))


@pytest.fixture(scope="module")
def pair(rendered_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first training sequence of each tier alone."""
    ignored = shutil.ignore_patterns("queries", "truth", ".*", "*-test-*", "*-000001")
    root = tmp_path_factory.mktemp("pair") / "set"
    shutil.copytree(rendered_dataset, root, ignore=ignored)
    kept = {path.name for path in root.glob("sequences/*/*")}
    change_rows("sequences.parquet", lambda rows: [row for row in rows if row["id"] in kept])(root)
    change_json("dataset.json", lambda document: document.update(splits=["train"]))(root)
    return root


@pytest.fixture
def two(pair: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(pair, tmp_path / "set"))


def mutate(root: Path, steps: Sequence[Mapping[str, Any]]) -> Report:
    """Carry out steps in the folder of every sequence, and validate."""
    for folder in sorted(root.glob("sequences/*/*")):
        for step in steps:
            if step.get("exr") == "FRAMES":
                depths = sorted(folder.glob("depth/*.exr"))
                perform(folder, [{**step, "exr": f"depth/{path.name}"} for path in depths])
            else:
                perform(folder, [step])
    listed()(root)
    return validate(root)


def test_the_set_is_valid_as_rendered(two: Path) -> None:
    report = mutate(two, [{"exr": "FRAMES", "by": "nothing"}, {"call": "see_again"}])
    assert [str(issue) for issue in report.issues] == []


def cases() -> Iterator[ParameterSet]:
    """Yield every mutation; `make test` has one of each code and all that name their cause."""
    seen: set[str | None] = set()
    for each in MUTATIONS:
        kept = "says" in each or each["code"] not in seen
        seen.add(each["code"])
        yield pytest.param(each, id=each["name"], marks=[] if kept else [pytest.mark.long])


@pytest.mark.parametrize("mutation", list(cases()))
def test_consistent_mutation(two: Path, mutation: dict[str, Any]) -> None:
    code, says = mutation["code"], mutation.get("says")
    report = mutate(two, mutation["steps"])
    assert report.counts
    issues = [issue for issue in report.issues if issue.code == code]
    assert issues or code is None, [str(issue) for issue in report.issues][:6]
    if says is not None:
        assert report.counts[code] > 500
        assert len(issues) <= 2, [str(issue) for issue in issues][:4]
        assert says in issues[0].message


def test_pictures_of_another_sequence(copy: Path) -> None:
    for tier in ("rope", "cloth-1"):
        first, second = sorted(copy.glob(f"sequences/{tier}/*-train-*"))
        for path in sorted(first.glob("rgb/*.png")):
            other = f"../{second.name}/rgb/{path.name}"
            perform(first, [{"swap": f"rgb/{path.name}", "other": other}])
    assert "COLOUR_DOUBTFUL" in mutate(copy, []).counts
