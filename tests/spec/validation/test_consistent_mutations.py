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

from pliant.spec.dataset import Dataset
from pliant.spec.io.png import read_rgb, write_rgb
from pliant.spec.io.yamlfiles import read_yaml
from pliant.spec.validation.validate import Report, validate
from tests.conformance.edits import change_exr, change_json, change_rows, listed
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


def test_independent_frames_called_an_episode(copy: Path) -> None:
    for path in copy.glob("sequences/*/*/sequence.json"):
        change_json(str(path.relative_to(copy)), lambda d: d.update(temporal=True))(copy)
    change_rows("sequences.parquet", lambda rows: [row | {"temporal": True} for row in rows])(copy)
    report = validate(copy)
    assert set(report.counts) == {"TEMPORAL_DOUBTFUL"}
    doubted = {issue.path.split("/")[1] for issue in report.issues}
    assert "rope" in doubted


@pytest.mark.parametrize("factor", [10.0, 0.1, 1000.0, 0.001])
def test_metres_per_unit(two: Path, factor: float) -> None:
    scale = {"tiers.each.objects.0.material.each.metres_per_unit": factor}
    perform(two, [{"json": "dataset.json", "scale": scale}])
    assert "SCALE_DISAGREES" in validate(two).counts


@pytest.mark.parametrize(
    ("what", "split"),
    [
        ("files", "train"),
        ("tables", "test"),
        ("pictures", "test"),
        pytest.param("files", "test", marks=pytest.mark.long),
        pytest.param("tables", "train", marks=pytest.mark.long),
        pytest.param("pictures", "train", marks=pytest.mark.long),
    ],
)
def test_content_that_is_there_twice(copy: Path, what: str, split: str) -> None:
    """A sequence appears again in another split, written by other encoders."""
    sequences = Dataset.open(copy).sequences
    source = next(s for s in sequences if s.tier == "rope" and s.split == "train")
    others = [s for s in sequences if s.tier == "rope" and s.split == split and s.id != source.id]
    target = others[0]
    for path in source.dir.rglob("*"):
        name = path.relative_to(source.dir)
        wanted = {
            "files": path.suffix != ".json" or path.name == "cameras.json",
            "tables": path.suffix == ".parquet" or path.name == "cameras.json",
            "pictures": path.suffix == ".png",
        }[what]
        if path.is_file() and wanted:
            shutil.copyfile(path, target.dir / name)
    for frame in range(source.frames):
        image = target.dir / f"rgb/{frame:06d}.png"
        write_rgb(image, read_rgb(image), level=9)
        change_exr(f"{target.dir.relative_to(copy)}/depth/{frame:06d}.exr", lambda c: None,
                   "NO_COMPRESSION")(copy)  # fmt: skip
    listed()(copy)
    code = "SPLIT_SHARED" if split == "test" else "FRAME_REPEATED"
    assert code in validate(copy).counts
