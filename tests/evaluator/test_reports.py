"""Reports, comparisons and leaderboards: what they say, and that they need nothing else."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pliant.cli.main import run
from pliant.evaluator import read_scores, write_report
from pliant.evaluator.comparison import differences, ranks
from pliant.evaluator.report.cells import heading
from pliant.evaluator.report.charts import interval_chart
from pliant.evaluator.report.leaderboard import fact_table, render_leaderboard
from pliant.evaluator.report.report import render_report
from pliant.evaluator.report.verdict import board_verdict, report_verdict
from pliant.spec.errors import CallError, SubmissionError
from tests.dataset_files import write_queries
from tests.evaluator.figures import figure


class Tags(HTMLParser):
    """Complains of unbalanced tags; `open` has those that are not closed."""

    VOID = frozenset({"meta", "br", "img", "link", "hr", "input"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take no note: the tag is closed."""

    def handle_endtag(self, tag: str) -> None:
        assert self.open, tag
        assert self.open.pop() == tag


def assert_whole(text: str) -> list[str]:
    """Check that a page is balanced and loads nothing from elsewhere; return what it contains."""
    assert Tags(text).open == []
    plain = re.sub(r"<(script|style)>.*?</\1>", "", text, flags=re.DOTALL)
    loads = re.findall(r'\s(?:src|href|xlink:href|srcset|data)="([^"]*)"', plain)
    assert all(load.startswith(("data:", "#")) for load in loads)
    return loads


def noisy(scene: Any, spread_px: float, uneven: float) -> pa.Table:
    """Return the truth with noise, by `uneven` more in every other pair and less between."""
    rng = np.random.default_rng(0)
    factor = np.where(scene.pair % 2, 1 + uneven, 1 - uneven)[:, None]
    uv = scene.true_px + factor * rng.normal(0, spread_px, (scene.rows, 2))
    sigma = rng.uniform(0.5, 2, scene.rows).astype(np.float32) * np.float32(spread_px)
    return scene.table(uv, sigma=sigma)


@pytest.fixture(scope="module")
def reports(scene_maker: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Reports of three methods: `near`, `nearly` (here better, there worse) and `far`."""
    folder = tmp_path_factory.mktemp("reports")
    scene = scene_maker(folder / "data", sequences=8, frames=2, queries=16)
    for name, spread, uneven in (("near", 3.0, 0.0), ("nearly", 3.0, 0.1), ("far", 12.0, 0.0)):
        scores = scene.score(folder, noisy(scene, spread, uneven), name=name)
        write_report(scores, folder / "reports" / name, data=scene.root)
    return folder / "reports"


def test_a_report_holds_three_files_and_reads_back(reports: Path) -> None:
    folder = reports / "near"
    assert sorted(p.name for p in folder.iterdir()) == [
        "per_pair.parquet", "report.html", "scores.json",
    ]  # fmt: skip
    scores = read_scores(folder)
    assert scores.method == "near"
    assert scores.per_pair.num_rows == scores.document["counts"]["pairs"] == 16
    table = scores.per_pair.to_pylist()
    assert sum(row["queries"] for row in table) == scores.document["counts"]["queries"]
    counted = sum(row["counted"] for row in table)
    squared = sum(row["sum_squared_px2"] for row in table)
    assert scores.overall["rmse_px"] == pytest.approx(np.sqrt(squared / counted), rel=1e-12)


def test_the_page_is_whole_and_loads_nothing(reports: Path) -> None:
    text = (reports / "near" / "report.html").read_text()
    loads = assert_whole(text)
    assert sum(load.startswith("data:image/jpeg") for load in loads) == 32  # each frame once
    page = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    ids = re.findall(r'\sid="([^"]*)"', page)
    assert len(ids) == len(set(ids)) > 32
    assert not re.search(r"@import|url\((?!#)", page)
    rmse = read_scores(reports / "near").overall["rmse_px"]
    for needed in ("near", "RMSE", "Provenance", "median error", f"{rmse:.2f}"):
        assert needed in text
    for chart in ("Reliability", "Sparsification"):
        assert f'aria-label="{chart}"' in text


def test_facts_of_a_method_are_read_without_python(reports: Path, tmp_path: Path) -> None:
    scores = read_scores(reports / "near")
    facts = {"masks": True, "size": [160, 120], "blur": {"px": 1.5, "by": None}}
    scores.document["submission"]["method"]["input"] = facts
    write_report(scores, tmp_path / "report")
    page = (tmp_path / "report" / "report.html").read_text()
    said = "masks: true, size: [160, 120], blur: (px: 1.5, by: null)"
    assert f"<dt>Method: input</dt><dd><code>{said}</code></dd>" in page


def test_a_method_that_equals_a_control_is_not_called_better_than_it() -> None:
    submission = {"kind": "answers", "method": {"name": "unmoved"}}
    said = report_verdict({"overall": {}, "submission": submission, "notes": {}})
    assert [sentence.partition(":")[0] for sentence in said] == ["No control is better"]


@pytest.mark.parametrize("value", [10**400, -1, True, None, "2"])
def test_a_number_that_is_none_is_no_fact(value: Any) -> None:
    names, rows = fact_table([{"seconds_per_pair": value}, {"seconds_per_pair": 0.25}])
    assert names == ["Answering, s per pair"]
    assert [row[0].text for row in rows] == ["", "0.25"]


def test_a_report_without_images_or_distribution_is_complete(
    scene_maker: Any, tmp_path: Path
) -> None:
    bare = scene_maker(tmp_path / "data", images=False, tiers=("rope",))
    for protocol in ("paper", "tapvid", "standard"):
        scores = bare.score(tmp_path, protocol=protocol)
        write_report(scores, tmp_path / protocol, data=bare.root)
        assert_whole((tmp_path / protocol / "report.html").read_text())


@pytest.mark.parametrize("protocol", ["standard", "tapvid", "track"])
def test_slices_have_the_headings_of_their_figures(scene: Any, protocol: str) -> None:
    table = scene.table(scene.true_px + np.array([3.0, 0.0]))
    page = render_report(scene.score(scene.root.parent, table, protocol=protocol))
    slices = page[page.index("<h2>Slices</h2>") : page.index("<h2>All metrics</h2>")]
    heads = re.findall(r'<th scope="col">([^<]+)</th>', slices)
    assert set(heads) == {"Queries", "RMSE, px", "Mean error, px", "PCK 8 px"}
    assert "<td>3.00</td>" in slices


def test_a_report_never_overwrites_something_else(scene: Any, tmp_path: Path) -> None:
    scores = scene.score(tmp_path, protocol="paper")
    target = tmp_path / "mine"
    target.mkdir()
    (target / "thesis.tex").write_text("precious")
    with pytest.raises(CallError, match=r"something other than a report; found thesis\.tex"):
        write_report(scores, target)
    assert [p.name for p in target.iterdir()] == ["thesis.tex"]
    with pytest.raises(CallError, match="a file"):
        write_report(scores, target / "thesis.tex")
    write_report(scores, tmp_path / "report")
    write_report(scores, tmp_path / "report")


def test_a_damaged_report_is_no_report(reports: Path, tmp_path: Path) -> None:
    folder = tmp_path / "damaged"
    shutil.copytree(reports / "near", folder)
    (folder / "scores.json").write_bytes(b"{}")
    for each in (folder, tmp_path):
        with pytest.raises(SubmissionError, match="not a report of pliant evaluate"):
            read_scores(each)


def test_verdicts_need_an_interval_that_excludes_zero(reports: Path) -> None:
    scores = [read_scores(reports / name) for name in ("near", "nearly", "far")]
    found = {(d.group, d.metric, d.method, d.against): d for d in differences(scores)}
    same = found["overall", "rmse_px", "nearly", "near"]
    assert same.verdict == "no clear difference"
    assert same.low < 0 < same.high
    worse = found["overall", "rmse_px", "far", "near"]
    assert worse.verdict == "worse"
    exact = figure(scores[2], "rmse_px") - figure(scores[0], "rmse_px")
    assert worse.value == pytest.approx(exact, rel=1e-12)
    assert worse.low < exact < worse.high
    pck = found["overall", "pck_8px", "far", "near"]
    assert pck.value < 0
    assert pck.verdict == "worse"
    standing = ranks(list(found.values()), ["near", "nearly", "far"])
    assert standing["overall", "rmse_px"] == [1, 1, 3]


def test_pairing_cancels_what_is_hard_for_both(scene_maker: Any, tmp_path: Path) -> None:
    """A small difference on sequences of very different difficulty is still clear."""
    scene = scene_maker(tmp_path / "data", sequences=10, images=False, tiers=("cloth",))
    rng = np.random.default_rng(0)
    hard = np.exp(rng.normal(1, 1.2, 10))[scene.pair]
    noise = rng.normal(0, 1, (scene.rows, 2)) * hard[:, None]
    scores = []
    for name, factor in (("good", 1.0), ("bad", 1.05)):
        table = scene.table(scene.true_px + noise * factor)
        scores.append(scene.score(tmp_path, table, name=name, protocol="paper"))
    low, high = scores[0].document["intervals"]["overall"]["rmse_px"]
    assert low < scores[1].overall["rmse_px"] < high  # the intervals alone could not tell
    first = differences(scores, ["rmse_px"])[0]
    assert first.verdict == "worse"


def test_reports_that_do_not_compare_are_refused(reports: Path, scene: Any, tmp_path: Path) -> None:
    near = read_scores(reports / "near")
    elsewhere = scene.score(tmp_path, name="other")
    with pytest.raises(CallError, match="other queries cannot be compared"):
        render_leaderboard([near, elsewhere])
    paper = scene.score(tmp_path, protocol="paper")
    with pytest.raises(CallError, match="different protocols"):
        differences([elsewhere, paper])
    with pytest.raises(CallError, match="only averaged metrics"):
        differences([elsewhere, elsewhere], ["median_px"])


def test_a_leaderboard_ranks_and_sorts(reports: Path, tmp_path: Path) -> None:
    assert run(["leaderboard", str(reports), "--out", str(tmp_path / "board.html")]) == 0
    text = (tmp_path / "board.html").read_text()
    assert_whole(text)
    names = re.findall(r'<th scope="row" data-key="(\w+)"', text)
    assert set(names) == {"near", "nearly", "far"}
    assert names[-1] == "far"
    assert re.findall(r'</th><td data-key="(\d+)"', text) == ["1", "1", "3"]


def test_compare_prints_verdicts_or_json(reports: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folders = [str(reports / name) for name in ("near", "far")]
    assert run(["compare", *folders]) == 0
    out = capsys.readouterr().out
    assert "RMSE (px), overall, lower is better\n  far against near: +" in out
    assert "Ranks by RMSE: 1. near, 2. far" in out
    assert "would separate them" not in out  # they are
    assert run(["compare", *folders, *["--metric", "rmse_px"] * 2, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert len({(d["group"], d["metric"]) for d in document["differences"]}) == len(
        document["differences"]
    )
    assert document["methods"] == ["near", "far"]
    assert {d["metric"] for d in document["differences"]} == {"rmse_px"}
    assert run(["compare", folders[0]]) == 2
    assert run(["compare", folders[0], "/nowhere"]) == 2


def test_compare_of_few_sequences_shows_the_order_and_no_rank(
    scene_maker: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = scene_maker(tmp_path / "data", sequences=2, images=False)
    reports = str(scene.reports(tmp_path, {"far": 9.0, "near": 3.0, "middle": 6.0}))
    assert run(["compare", reports, "--metric", "rmse_px", "--metric", "pck_8px"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "RMSE (px), overall, best first: near 3.00, middle 6.00, far 9.00"
    assert lines[3] == "PCK 8 px, overall, best first: middle 1.000, near 1.000, far 0.000"
    assert lines[6].startswith("No verdict on 18 differences: 4 sequences, and at least 6 are ")
    assert len(lines) == 7
    metrics = ["--metric", "flip_rate", "--metric", "outside_image_rate"]
    assert run(["compare", reports, *metrics]) == 0
    lines = capsys.readouterr().out.splitlines()
    # Only the cloth has symmetries.
    assert lines[1].startswith("Flip rate of pairs, cloth, best first: ")
    assert lines[2].startswith("Answers outside the image, overall, lowest first: ")


def test_compare_names_the_metrics_that_methods_have_no_value_of(
    scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reports = str(scene.reports(tmp_path, {"far": 9.0, "near": 3.0}))
    assert run(["compare", reports, *["--metric", "nll"] * 2, "--metric", "jitter_px"]) == 0
    line = "Not compared, because fewer than two methods have a value: NLL; Jitter.\n"
    assert capsys.readouterr().out == line
    assert run(["compare", reports]) == 0
    assert "Not compared" not in capsys.readouterr().out


def test_a_metric_without_a_better_direction_has_no_verdict(
    scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reports = str(scene.reports(tmp_path, {"far": 300.0, "near": 3.0}))
    call = ["compare", reports, "--metric", "outside_image_rate"]
    assert run(call) == 0
    assert capsys.readouterr().out.splitlines()[1].endswith("] (6 sequences)")
    assert run([*call, "--json"]) == 0
    (whole, *_) = json.loads(capsys.readouterr().out)["differences"]
    assert (whole["group"], whole["verdict"]) == ("overall", "no clear difference")
    assert whole["high"] < 0


def test_a_headline_without_averages_is_listed_and_not_tested(
    scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reports = str(scene.reports(tmp_path, {"far": 9.0, "near": 3.0}, protocol="auc"))
    board = tmp_path / "board.html"
    assert run(["leaderboard", reports, "--out", str(board)]) == 0
    text = board.read_text()
    assert re.findall(r'<th scope="row" data-key="(\w+)"', text) == ["near", "far"]
    assert "AUC 3 px is not an average" in text
    capsys.readouterr()
    assert run(["compare", reports]) == 0
    assert capsys.readouterr().out.startswith("PCK 1 px, overall, ")


def test_a_leaderboard_says_why_no_method_has_a_rank(scene: Any, tmp_path: Path) -> None:
    table = scene.table(scene.true_px + 4.0)
    scores = scene.score(tmp_path, table, name="mine", protocol="track")
    assert scores.overall["rmse_px_after_10"] is None
    for reports in ([scores], [scores, scores]):
        page = render_leaderboard(reports)
        assert "No method has a value of RMSE after 10 frames, so none has a rank." in page
        assert "The rank counts" not in page


def test_two_reports_of_one_control_are_both_controls(scene: Any, tmp_path: Path) -> None:
    reports = [
        scene.score(tmp_path, scene.table(scene.true_px + off), name=name, protocol="paper")
        for name, off in (("mine", 4.0), ("identity", 9.0), ("identity", 9.0))
    ]
    page = render_leaderboard(reports)
    assert "1 method and 2 controls" in page
    assert "mine (5.66 px) beats answering with the query" in page


def test_sequences_that_are_only_targets_are_counted(scene_maker: Any, tmp_path: Path) -> None:
    made = scene_maker(tmp_path / "data", sequences=3, images=False, tiers=("cloth",))
    names = made.queries["sequence_b"].to_pylist()
    asked = [{**row, "sequence_b": names[-1]} for row in made.queries.to_pylist()[:40]]
    tables = write_queries(made.root, "analytic", "test", asked, made.truth.to_pylist()[:40])
    scores = replace(made, queries=tables[0], truth=tables[1]).score(tmp_path)
    assert scores.document["counts"]["sequences"] == {"overall": 3, "cloth": 3}


def test_the_verdict_of_two_methods() -> None:
    shown = heading("rmse_px", {"protocol": "standard"})
    said = board_verdict({"sift": 5.0, "orb": 6.0}, {"centroid": 9.0}, shown)
    assert said.startswith("Both methods beat answering with the middle of the object (RMSE 9.0")
    assert said.endswith("the best is sift with 5.00 px.")


@pytest.mark.parametrize("paper", ["#ffffff", "#16191c"])
def test_marks_of_a_chart_are_seen_on_light_and_dark_pages(paper: str) -> None:
    chart = interval_chart({"a": (-1.0, 0.5, 2.0)}, title="t", x="x")
    for colour in set(re.findall("#[0-9a-f]{6}", json.dumps(chart))):
        dark, light = sorted((luminance(colour), luminance(paper)))
        assert (light + 0.05) / (dark + 0.05) >= 3, colour


def luminance(colour: str) -> float:
    """Return the relative luminance of `#rrggbb` (WCAG 2)."""
    rgb = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
