"""The comparison of speed over releases: what is kept, and what is called a regression."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.benchmarks.conftest import BENCHMARKS, script


@pytest.fixture(scope="module")
def releases() -> Iterator[Any]:
    with script("over_releases") as module:
        yield module


def test_figures_are_kept_so_that_lower_is_better(releases: Any) -> None:
    record = {"share": 3.0, "speed": 4.0, "cpu_s": 5.0, "per_s": 10.0, "frames": 7}
    kinds = {"share": "ratio", "speed": "inverse", "cpu_s": "cpu", "per_s": "rate"}
    found = releases.kept(record, kinds, 0.5)
    assert found == {"share": 3.0, "speed": 0.25, "cpu_s": 10.0, "per_s": 0.2}


def test_a_figure_worse_by_more_than_a_tenth_is_named(releases: Any) -> None:
    then = {"evaluation": {"a": 1.0, "b": 1.0, "c": 1.0}}
    now = {"evaluation": {"a": 1.09, "b": 1.11, "c": 0.5, "new": 9.0}, "other": {"a": 9.0}}
    assert releases.regressions(now, then) == ["evaluation b"]


def test_releases_are_ordered_as_versions(releases: Any, tmp_path: Path) -> None:
    assert releases.last_release(tmp_path) is None
    for version in ("0.9.0", "0.10.0", "0.2.1"):
        (tmp_path / f"{version}.json").write_text("{}")
    assert releases.last_release(tmp_path).stem == "0.10.0"


def test_a_kept_release_is_compared_and_a_regression_ends_with_1(
    releases: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    figures = {"ratio_to_reading": 2.0}
    monkeypatch.setattr(releases, "measured", lambda name: figures)
    monkeypatch.setattr(releases, "RELEASES", tmp_path)
    assert releases.run(["evaluation"], "1.2.0") == 0
    assert json.loads((tmp_path / "1.2.0.json").read_text()) == {"evaluation": figures}
    assert releases.run(["evaluation"], None) == 0
    figures = {"ratio_to_reading": 2.3}
    assert releases.run(["evaluation"], None) == 1
    assert "+15 %  REGRESSION" in capsys.readouterr().out


def test_every_benchmark_gives_the_figures_that_are_kept(releases: Any) -> None:
    """Names in the sources, where f-strings stand for the varying part."""
    for name, figures in releases.KEPT.items():
        source = (BENCHMARKS / f"{name}.py").read_text()
        written = [re.escape(each) for each in re.findall(r'f?"([\w{}]+)"', source)]
        patterns = [re.sub(r"\\{\w+\\}", r"\\w*", each) for each in written]
        for figure in figures:
            found = [each for each in patterns if re.fullmatch(each, figure)]
            assert found, f"{name}.py writes no {figure}"
