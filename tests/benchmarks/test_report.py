"""A benchmark with several tiers in one set, scored by two protocols, and its report."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import pytest

from pliant.benchmarks.suite.checksums import Differences
from pliant.benchmarks.suite.config import BenchmarkConfig
from pliant.benchmarks.suite.config_file import read_config
from pliant.benchmarks.suite.page import rmse_by_tier, write_results
from pliant.benchmarks.suite.run import run_benchmark
from pliant.benchmarks.suite.table import Row, finished_rows
from pliant.benchmarks.suite.work import Workspace
from pliant.evaluator import read_scores
from pliant.spec.errors import SpecError
from pliant.spec.validation.validate import Report
from tests.benchmarks.jobs_here import Recorder, jobs_here

TIERS = ("rope", "cloth-1")

CONFIG = """
name: two
version: 1.0.0
validated: true
sets:
  both:
    title: Two tiers
    tiers: [rope, cloth-1]
    style: raster
    width: 320
    height: 240
    splits: {test: 1}
    frames: 2
    queries: {pairs_per_sequence: 1, queries_per_pair: 12}
tests:
  rope: &test
    title: Rope
    tier: rope
    variants: {clean: both}
    methods: [sift, centroid, oracle]
    tracks: [given]
  cloth-1: {<<: *test, title: Cloth, tier: cloth-1}
"""


Made = tuple[BenchmarkConfig, Path, list[Row]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("two")
    (folder / "two.yaml").write_text(CONFIG)
    config = read_config(folder / "two.yaml")
    with jobs_here():
        run_benchmark(config, folder / "out", workers=1, watcher=Recorder())
    return config, folder / "out", finished_rows(config, Workspace(folder / "out"))


def test_each_row_has_the_scores_of_its_own_tier(made: Made) -> None:
    config, out, rows = made
    assert len(rows) == 6
    found = rmse_by_tier(config, rows)
    assert list(found) == list(TIERS)
    for method in ("sift", "centroid", "oracle"):
        scores = read_scores(out / "scores" / "both" / f"{method}--given" / "standard")
        assert {tier: found[tier][method] for tier in TIERS} == {
            tier: values["rmse_px"] for tier, values in scores.tiers.items()
        }
    assert found["rope"]["centroid"] != found["cloth-1"]["centroid"]
    assert found["rope"]["oracle"] == 0


def test_only_keypoint_methods_have_scores_of_matches(made: Made) -> None:
    _, out, rows = made
    assert {row.method for row in rows if "matches" in row.scores} == {"sift"}
    assert {path.name for path in (out / "answers" / "both").iterdir()} == {
        "sift--given.parquet", "sift--given-matches.parquet", "centroid--given.parquet",
        "oracle--given.parquet",
    }  # fmt: skip


def test_report_and_results_show_every_tier(made: Made) -> None:
    config, out, _ = made
    write_results(config, out, Differences(False, {}), "a command")
    page = (out / "report" / "index.html").read_text()
    assert page.count("<h2>") == 3  # the scores and both tiers
    assert page.count("Best: without learning") == 2
    assert "without learning Oracle" not in page
    assert page.count('class="causes"') == 2  # SIFT of both tiers
    assert page.count("data:image/png") == 2
    assert page.count('class="pair"') == 2  # SIFT's best matches of each tier
    assert page.count('href="../scores/both/sift--given/standard/report.html"') == 2
    assert page.count('<th scope="row" class="control">') == 4  # centroid and oracle
    results = (out / "results.md").read_text()
    assert "RMSE is in pixels at 320x240" in results
    assert results.count("| Oracle | 0.0") == 2
    assert "## The paper's table" not in results
    assert "What one thing adds" not in results


def test_a_set_that_violates_the_specification_stops_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "two.yaml").write_text(CONFIG)
    config = read_config(
        tmp_path / "two.yaml", ["sets.both.tiers=[rope]", "tests.cloth-1.tier=rope"]
    )
    real = run_benchmark.__globals__["validate"]

    def damaged(root: Path, workers: int) -> Report:
        (root / "truth" / "test.parquet").write_bytes(b"PAR1")
        found: Report = real(root, workers=workers)
        return found

    monkeypatch.setitem(run_benchmark.__globals__, "validate", damaged)
    with jobs_here(), pytest.raises(SpecError, match="violates the specification"):
        run_benchmark(config, tmp_path / "out", workers=1, until="generate", watcher=Recorder())


def test_the_demo_is_a_config_of_the_package() -> None:
    config = read_config(Path(str(files("pliant.benchmarks.suite") / "demo.yaml")))
    assert config.validated
    assert [test.tier for test in config.tests.values()] == ["rope", "cloth-1", "cloth-3"]
    assert {name: made.id for name, made in config.sets.items()} == {
        "rope": "pliant-demo-rope", "cloth": "pliant-demo-cloth",
    }  # fmt: skip
    assert {made.style for made in config.sets.values()} == {"fast"}
    assert {test.tracks for test in config.tests.values()} == {("given",)}
    assert [test.shipped for test in config.tests.values()] == [
        ("don-rope",), ("don-cloth",), ("don-cloth",),
    ]  # fmt: skip
