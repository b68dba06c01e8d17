"""Protocols of a file: scored by command and API, and shown without the file or its modules."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.cli.main import run
from pliant.evaluator import read_protocol, read_scores, write_report
from pliant.evaluator.report.leaderboard import render_leaderboard
from pliant.evaluator.report.report import render_report
from pliant.evaluator.scores import SCORES_JSON
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.io.yamlfiles import yaml_text

_DOUBLED = """
from pliant.evaluator.metrics.base import Metric
from pliant.evaluator.statistics.ratios import Ratio


class Doubled(Metric):
    @classmethod
    def figures(cls, settings):
        about = "twice the mean error"
        return [Ratio("doubled_px", "lower", "px", about, "Doubled", "sum_doubled_px", "counted")]

    def update(self, block):
        self.add_sums(block, sum_doubled_px=2 * block.counted * block.error_px)
"""


def own_protocol(path: Path, base: str = "paper", **changes: Any) -> Path:
    """Write a protocol that differs from a built-in one."""
    document = {**read_protocol(base).document, "name": "mine", **changes}
    path.write_text(json.dumps(document) if path.suffix == ".json" else yaml_text(document))
    return path


@pytest.mark.parametrize("name", ["mine.json", "mine.yaml"])
def test_evaluate_and_its_pages_take_a_protocol_file(
    name: str, scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    metrics = {**read_protocol("standard").metrics}
    metrics["pck"] = {**metrics["pck"], "thresholds_px": [2.5, 8]}
    headline = ["pck_2.5px", "rmse_px"]
    path = own_protocol(tmp_path / name, "standard", metrics=metrics, headline=headline)
    for method, off in (("far", 3.0), ("near", 2.0)):
        table = scene.table(scene.true_px + np.array([off, 0]))
        given = scene.submit(tmp_path / f"{method}.parquet", table, method={"name": method})
        out = ["--data", str(scene.root), "--out", str(tmp_path / "reports" / method)]
        assert run(["evaluate", str(given), *out, "--protocol", str(path)]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[0].endswith("protocol mine 1.3")
        assert lines[1].split("overall")[0].strip() == "PCK 2.5 px"
    path.unlink()
    scores = read_scores(tmp_path / "reports" / "near")
    assert scores.document["own_protocol"]["document"]["metrics"]["pck"] == metrics["pck"]
    assert scores.document["headline"] == headline
    page = render_report(scores)
    assert "share of answers within 2.5 px" in page
    assert '<th scope="col">PCK 8 px</th>' in page  # of slices
    assert "thresholds_px&#34;: [\n" in page.replace("&quot;", "&#34;")
    folders = [str(tmp_path / "reports" / method) for method in ("far", "near")]
    assert run(["compare", *folders]) == 0
    said = capsys.readouterr().out
    assert "PCK 2.5 px, overall, higher is better\n  near against far: +1.000" in said
    assert "Ranks by PCK 2.5 px: 1. near, 2. far" in said
    assert run(["leaderboard", *folders, "--out", str(tmp_path / "site")]) == 0
    assert "PCK 2.5 px" in (tmp_path / "site" / "index.html").read_text()


def test_python_takes_a_protocol_file(scene: Any, tmp_path: Path) -> None:
    path = own_protocol(tmp_path / "mine.json")
    table = scene.table(scene.true_px + 1.0)
    found = pliant.evaluate(scene.root, table, scene.split, protocol=path)
    assert found.document == scene.score(tmp_path, table, protocol=path).document | {
        "submission": found.document["submission"]
    }
    assert found.overall == scene.score(tmp_path, table, protocol="paper").overall
    assert "own_protocol" not in scene.score(tmp_path, table, protocol="paper").document


def test_a_protocol_with_a_built_in_name_has_its_own_headings(scene: Any, tmp_path: Path) -> None:
    metrics = {"pck": {**read_protocol("standard").metrics["pck"], "thresholds_px": [7]}}
    changes: dict[str, Any] = {"name": "paper", "headline": ["pck_7px"], "metrics": metrics}
    path = own_protocol(tmp_path / "paper.json", **changes)
    page = render_report(scene.score(tmp_path, protocol=path))
    assert "share of answers within 7 px" in page


def test_shown_scores_import_nothing_that_they_name(
    scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "strange").mkdir()
    (tmp_path / "strange" / "doubled.py").write_text(_DOUBLED)
    changes: dict[str, Any] = {"metrics": {"doubled:Doubled": {}}, "headline": ["doubled_px"]}
    path = own_protocol(tmp_path / "mine.json", **changes)
    with monkeypatch.context() as patch:
        patch.syspath_prepend(str(tmp_path / "strange"))
        reports = scene.reports(tmp_path, {"far": 9.0, "near": 3.0}, protocol=path)
        assert sys.modules.pop("doubled")
    folders = [str(reports / name) for name in ("far", "near")]
    assert run(["compare", *folders]) == 0
    assert "Doubled (px), overall, lower is better\n" in capsys.readouterr().out
    page = render_leaderboard([read_scores(reports / name) for name in ("far", "near")])
    assert page.index('data-key="near"') < page.index('data-key="far"')
    assert "twice the mean error" in render_report(read_scores(reports / "near"))
    assert "doubled" not in sys.modules


def test_scores_do_not_name_a_file_to_read(scene: Any, tmp_path: Path) -> None:
    path = own_protocol(tmp_path / "mine.json")
    scores = scene.score(tmp_path, protocol="paper")
    scores.document["protocol"] = str(path)
    for show in (render_report, lambda each: render_leaderboard([each, each])):
        with pytest.raises(CallError, match="no such protocol"):
            show(scores)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"headline": ["rmse"]}, "mine.json, headline: .* does not compute; found rmse; required"),
        ({"metrics": {"hubber": {}}}, "no such family of metrics; found 'hubber'"),
        ({"metrics": {"pathlib:Path": {}}}, "no such family of metrics; found 'pathlib:Path'"),
        ({"metrics": {":Pck": {}}}, "no such family of metrics; found ':Pck'"),
        ({"metrics": {".pck:Pck": {}}}, "no such family of metrics; found '.pck:Pck'"),
        ({"kind": "answer"}, "mine.json, kind: unknown value"),
        ({"kind": "matches"}, "mine.json, metrics: .*required: the family matches"),
        ({"counts": "all"}, "mine.json, counts: unknown setting"),
    ],
)
def test_a_protocol_file_with_a_fault_is_refused(
    change: dict[str, Any], message: str, scene: Any, tmp_path: Path
) -> None:
    path = own_protocol(tmp_path / "mine.json", **change)
    with pytest.raises(CallError, match=message):
        scene.score(tmp_path, protocol=path)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("mine.json", "{", "not strict JSON"),
        ("mine.json", "[1]", "settings must be a mapping"),
        ("mine.yaml", "a: [", "not YAML"),
        ("mine.yaml", "- a", "must be a mapping"),
        ("mine.yaml", "", "a setting is missing"),
    ],
)
def test_a_file_that_is_no_protocol_is_a_wrong_call(
    name: str, text: str, message: str, scene: Any, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    path = tmp_path / name
    path.write_text(text)
    given = str(scene.submit(tmp_path / "s.parquet"))
    assert run(["evaluate", given, "--data", str(scene.root), "--protocol", str(path)]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert name in said


def test_the_schema_refuses_figures_that_pages_cannot_show(scene: Any, tmp_path: Path) -> None:
    path = own_protocol(tmp_path / "mine.json")
    write_report(scene.score(tmp_path, protocol=path), tmp_path / "report")
    written = tmp_path / "report" / SCORES_JSON
    document = json.loads(written.read_text())
    document["own_protocol"]["figures"][0]["better"] = "greener"
    written.write_text(json.dumps(document))
    with pytest.raises(SubmissionError, match="greener"):
        read_scores(tmp_path / "report")
