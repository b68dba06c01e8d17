"""A whole reference benchmark at the size of a thumb."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from pliant.benchmarks.suite import run as suite_run
from pliant.benchmarks.suite.checksums import (
    Differences,
    compare_checksums,
    read_frozen,
    set_checksums,
)
from pliant.benchmarks.suite.config import BenchmarkConfig
from pliant.benchmarks.suite.config_file import read_config
from pliant.benchmarks.suite.page import results_page, write_results
from pliant.benchmarks.suite.run import run_benchmark
from pliant.benchmarks.suite.table import Row, arms, best, blocks, finished_rows
from pliant.benchmarks.suite.work import Cost, Workspace
from pliant.cli.main import cli, run
from pliant.spec.errors import CallError, TrainingError
from pliant.spec.io.parquet import read_footer
from tests.benchmarks.jobs_here import Recorder, generate_here, jobs_here
from tests.known import known


@pytest.fixture(scope="module", autouse=True)
def _quick_shipped_model(quick_run: Path) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suite_run, "FOLDER", quick_run.parent)
        yield


class Made(NamedTuple):
    """A finished benchmark, which was interrupted once on its way."""

    config: BenchmarkConfig
    work: Workspace
    watcher: Recorder

    @property
    def rows(self) -> list[Row]:
        return finished_rows(self.config, self.work)


@pytest.fixture(scope="module")
def made(config_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Made:
    out = tmp_path_factory.mktemp("made") / "out"
    config, watcher = read_config(config_file), Recorder()
    watcher.interrupt_at = "more-contrastive"
    with jobs_here():
        with pytest.raises(KeyboardInterrupt):
            run_benchmark(config, out, workers=1, watcher=watcher)
        watcher.interrupt_at = None
        run_benchmark(config, out, resume=True, workers=1, watcher=watcher)
    return Made(config, Workspace(out), watcher)


@pytest.fixture(scope="module")
def written(made: Made) -> tuple[str, str]:
    """The page and the report of the finished benchmark."""
    config, work, out = made.config, made.work, made.work.root
    write_results(config, out, compare_checksums(config, work), "pliant benchmark")
    return (out / "results.md").read_text(), (out / "report" / "index.html").read_text()


def test_some_blocks_alone_with_what_they_need(config_file: Path, tmp_path: Path) -> None:
    config = read_config(config_file)
    seeds = config.only(["rope-seeds"])
    assert set(seeds.sets) == {"rope", "rope-noisy"}  # asked, and trained on
    assert set(seeds.runs) == {"twice-0", "twice-1"}
    assert (list(seeds.tests), seeds.comparisons) == (["rope-seeds"], ())
    assert len(config.only(["rope"]).comparisons) == 2
    with pytest.raises(CallError, match=r"unknown block.*rope-seed.*Did you mean 'rope-seeds'"):
        config.only(["rope-seed"])
    values = yaml.safe_load(config_file.read_text())
    values["tests"]["free"] = {
        **values["tests"]["rope-seeds"], "variants": {"noisy": "rope-noisy"},
        "runs": [], "methods": ["identity"],
    }  # fmt: skip
    path = tmp_path / "thumb.yaml"
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    called = ["benchmark", str(path), "--test", "free", "--workers", "1"]
    with jobs_here():
        assert run([*called, "--out", str(tmp_path / "out")]) == 0
    assert [each.name for each in (tmp_path / "out" / "sets").iterdir()] == ["rope-noisy"]
    page = (tmp_path / "out" / "results.md").read_text()
    assert f"`pliant benchmark {path} --out DIR --test free`" in page
    assert "| Identity |" in page


@pytest.mark.long
def test_an_interrupted_benchmark_goes_on_and_repeats_nothing(made: Made) -> None:
    watcher = made.watcher
    assert watcher.begun[:2] == [("generate", 2, 0), ("train", 4, 0)]
    assert watcher.begun[2:] == [("generate", 2, 2), ("train", 4, 1), ("answer", 34, 0)]
    assert sorted(watcher.done) == sorted(set(watcher.done))
    assert ("small", 4, 4) in watcher.steps


def test_table_and_page(config_file: Path, made: Made) -> None:
    out = made.work.root
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}
    called = ["benchmark", str(config_file), "--out", str(out), "--resume", "--workers", "1"]
    result = CliRunner().invoke(cli, [*called, "--json"])
    assert result.exit_code == 0, result.output
    table = json.loads(result.stdout)
    assert before == {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}
    rows = {
        (row["variant"], row["method"], row["track"], row["blank"]): row
        for row in table["rows"]
        if row["test"] == "rope"
    }
    assert len(rows) == 26
    # A row says what the report in scores/ says.
    place = out / "scores/rope-noisy/more-contrastive--given/standard/scores.json"
    report = json.loads(place.read_text())
    values = rows["noisy", "more-contrastive", "given", False]["scores"]["standard"]["values"]
    assert values["rmse_px"] == report["overall"]["rmse_px"]
    shipped = rows["clean", "don-rope", "none", False]
    assert shipped["label"] == "don-rope, as shipped"
    assert shipped["train_cpu_s"] is None
    (fused,) = (row for row in table["rows"] if row["method"] == "fused:don-rope")
    assert fused["label"] == "fused:don-rope, margin_px=2"
    footer = read_footer(out / "answers" / "rope" / "fused-don-rope--none.parquet")
    assert footer["method"]["matcher"]["answer"]["margin_px"] == 2
    assert rows["clean", "small", "none", False]["train_cpu_s"] > 0
    assert {row["method"] for row in rows.values() if "matches" in row["scores"]} == {"sift"}
    blank = rows["clean", "don-rope", "given", True]
    assert blank["label"] == "don-rope, as shipped, blank picture"
    assert ("clean", "don-rope", "none", True) not in rows
    text = (out / "results.md").read_text()
    tracks = [line for line in text.splitlines() if line.startswith("## ")]
    assert tracks[:3] == [
        "## The paper's table",
        "## Track: image alone",
        "## Track: perfect masks",
    ]
    (line,) = [each for each in text.splitlines() if each.startswith("| contrastive | 28.5 |")]
    contrastive = rows["clean", "more-contrastive", "none", False]["scores"]["standard"]["values"]
    assert f" {contrastive['rmse_px']:.1f} [" in line
    (line,) = [each for each in text.splitlines() if each.startswith("| distributional |")]
    assert line.count("not run") == 3
    assert "| DON + Lipschitz | " in text
    assert "| PCK 2 px |" in text  # a figure that the config names; no row has the other one
    assert "Least probability" not in text
    assert f"{values['rmse_px']:.1f} [" in text
    assert "Does it help" in text


def test_report_shows_tables_and_pictures(written: tuple[str, str]) -> None:
    report = written[1]
    assert report.count("data:image/png") == 3 + 4  # frames of every test; two layers of a pair
    assert 'id="kept"' in report
    assert "Scores: image alone" in report
    assert report.count('href="../scores/rope/sift--none/standard/report.html"') == 1
    assert report.count('class="control"') > 0
    assert "The ten best matches" in report


def test_what_was_not_run_is_listed(made: Made) -> None:
    rows = [row for row in made.rows if (row.test, row.method) != ("rope", "sift")]
    rows += [row for row in made.rows if row.method == "sift" and row.entry.track != "none"]
    text = results_page(made.config, made.work, rows, Differences(False, {}), "a command")
    assert "- Rope: clean: image alone: sift\n" in text


def test_controls_compete_with_what_is_not_learned(made: Made) -> None:
    found = blocks(made.config, made.rows)
    assert [(each[0].test, each[0].entry.track) for each in found] == [
        ("rope", "none"), ("rope", "none"), ("rope-image", "none"),
        ("rope", "given"), ("rope", "given"), ("rope-seeds", "given"),
    ]  # fmt: skip
    row = known(best(found[2], "standard", "rmse_px", learned=False))
    assert row.method == "centroid"
    learned = known(best(found[3], "standard", "rmse_px", learned=True))
    assert not learned.entry.is_blank


def test_seeds_are_trained_each_and_reported_as_their_mean(
    made: Made, written: tuple[str, str]
) -> None:
    config, rows = made.config, made.rows
    assert config.members("twice") == ("twice-0", "twice-1")
    assert [config.runs[name].settings["seed"] for name in config.members("twice")] == [0, 1]
    single = [row for row in rows if row.test == "rope-seeds" and not row.entry.is_blank]
    (row,) = arms(single)
    errors = [each.value("standard", "rmse_px") or 0.0 for each in single]
    assert errors[0] != errors[1]
    assert row.value("standard", "rmse_px") == pytest.approx(np.mean(errors))
    assert row.interval("standard", "rmse_px") == (min(errors), max(errors))
    text = written[0]
    assert "Not run yet" not in text
    (line,) = [each for each in text.splitlines() if each.startswith("| Is it chance")]
    # The pooled RMSE over both seeds minus that of the run without seeds.
    pooled = np.sqrt(np.mean(np.square(errors)))
    against = next(
        each.value("standard", "rmse_px") or 0.0
        for each in rows
        if (each.method, each.variant, each.entry.track) == ("small", "noisy", "given")
        and not each.entry.is_blank
    )
    assert f"{pooled - against:+.1f}" in line


def test_masks_are_withheld_where_a_test_says_so(made: Made) -> None:
    facts = {
        name: read_footer(made.work.root / f"answers/rope/{name}.parquet")["method"]
        for name in ("twice-0--none", "small--given", "small--given--blank")
    }
    assert [each["mask"] for each in facts.values()] == ["none", "given", "given"]
    assert "picture" not in facts["small--given"]
    assert facts["small--given--blank"]["picture"] == "blank"


def test_frozen_checksums(
    config_file: Path, made: Made, capsys: pytest.CaptureFixture[str]
) -> None:
    config, work, out = made.config, made.work, made.work.root
    assert not compare_checksums(config, work).frozen
    frozen = config_file.parent / "thumb.sha256.json"
    try:
        frozen.write_text((out / "checksums.json").read_text())
        assert compare_checksums(config, work).sets == {}
        document = json.loads(frozen.read_text())
        first = next(iter(document["sets"]["rope"]["tables"]))
        document["sets"]["rope"]["tables"][first] = "0" * 64
        document["sets"]["rope-noisy"]["queries"] = "0" * 64
        frozen.write_text(json.dumps(document))
        differing = compare_checksums(config, work).sets
        assert first in differing["rope"]
        assert differing["rope-noisy"] == "its queries"
        called = ["benchmark", str(config_file), "--out", str(out), "--resume"]
        assert run([*called, "--until", "generate", "--test", "rope-seeds"]) == 1
        assert "Not the frozen test queries: rope" in capsys.readouterr().err
        assert "not the frozen ones" in (out / "results.md").read_text()
        frozen.write_text(json.dumps({**document, "version": "2.0.0"}))
        with pytest.raises(CallError, match="another benchmark"):
            read_frozen(config)
    finally:
        frozen.unlink()


def test_the_same_config_gives_the_same_queries(made: Made, tmp_path: Path) -> None:
    noisy = {"rope-noisy": made.config.sets["rope-noisy"]}
    one = made.config.replace(sets=noisy, runs={}, tests={}, comparisons=())
    with jobs_here():
        run_benchmark(one, tmp_path / "again", workers=1, until="generate", watcher=Recorder())
    again = set_checksums(tmp_path / "again" / "sets" / "rope-noisy")
    assert again == set_checksums(made.work.set_path("rope-noisy"))


def test_folders_that_cannot_be_taken(made: Made, tmp_path: Path) -> None:
    config, out = made.config, made.work.root

    def make(config: BenchmarkConfig, folder: Path, resume: bool = False) -> None:
        run_benchmark(config, folder, resume=resume, workers=1, watcher=Recorder())

    with pytest.raises(CallError, match="begun already"):
        make(config, out)
    with pytest.raises(CallError, match="another benchmark"):
        make(config.replace(version="2.0.0"), out, resume=True)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("mine")
    with pytest.raises(CallError, match="not empty"):
        make(config, tmp_path / "mine", resume=True)
    longer = {**config.runs["small"].settings, "steps": 6}
    changed = {**config.runs, "small": config.runs["small"].replace(settings=longer)}
    with pytest.raises(CallError, match="made with other settings"):
        make(config.replace(runs=changed), out, resume=True)


def test_a_set_without_queries_ends_the_benchmark(config_file: Path, tmp_path: Path) -> None:
    """One sequence of one frame has no pair of pictures."""
    config = read_config(config_file)
    one = {"rope": config.sets["rope"].replace(splits={"test": 1})}
    config = config.replace(sets=one, runs={}, tests={}, comparisons=())
    no_queries = "sets/rope: the dataset has no queries for split 'test'"
    with jobs_here(), pytest.raises(CallError, match=no_queries):
        run_benchmark(config, tmp_path / "out", workers=1, watcher=Recorder())


def test_wrong_checksums_end_the_benchmark_before_it_begins(
    config_file: Path, tmp_path: Path
) -> None:
    frozen = tmp_path / "thumb.sha256.json"
    frozen.write_text('{"name": "thumb", "version": "0.9.0", "sets": {}}')
    config = read_config(config_file).replace(checksums=frozen)
    with pytest.raises(CallError, match=r"thumb\.sha256\.json: the checksums belong to another"):
        run_benchmark(config, tmp_path / "out", workers=1, watcher=Recorder())
    assert not (tmp_path / "out").exists()


def test_a_failed_training_is_told_and_the_rest_is_kept(
    config_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(suite_run, "generate", generate_here)
    config = read_config(config_file)
    wrong = config.runs["small"].replace(settings={**config.runs["small"].settings, "tier": "x"})
    few = {"rope": config.sets["rope"].replace(splits={"train": 1, "test": 2})}
    config = config.replace(sets=few, runs={"small": wrong}, tests={}, comparisons=())
    out = tmp_path / "out"
    watcher = Recorder()
    watcher.ended = lambda *_: None  # type: ignore[method-assign]
    with pytest.raises(TrainingError, match="small: "):
        run_benchmark(config, out, workers=1, watcher=watcher)
    assert Workspace(out).finished("set/rope") is not None
    assert Workspace(out).finished("run/small") is None


def test_costs_add_up_over_attempts(tmp_path: Path) -> None:
    work = Workspace(tmp_path)
    work.open("a", "1", resume=False)
    work.record("run/x", "d", Cost(2.0, 3.0), finished=False)
    assert work.finished("run/x") is None
    work.record("run/x", "d", Cost(1.0, 1.5), finished=True)
    assert work.cost("run/x") == Cost(3.0, 4.5)
    work.record("run/x", "e", Cost(1.0, 1.0), finished=False)  # made again from other things
    work.record("run/x", "f", Cost(2.0, 2.0), finished=False)
    work.record("run/x", "f", Cost(2.0, 2.0), finished=True)
    assert work.cost("run/x") == Cost(4.0, 4.0)
