"""What a benchmark writes: its tables as JSON, as a Markdown page and as a report in HTML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pliant.benchmarks.suite.checksums import Differences
from pliant.benchmarks.suite.config import TRACKS, BenchmarkConfig
from pliant.benchmarks.suite.pictures import opening, set_pictures
from pliant.benchmarks.suite.table import Row, finished_rows, table_document
from pliant.benchmarks.suite.tables import comparison_table, cost_tables, paper_tables, score_tables
from pliant.benchmarks.suite.work import Workspace
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.report.pages import render_page
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.writing import write_file

_TEMPLATES = "pliant.benchmarks.suite"


def write_results(
    config: BenchmarkConfig, out: Path, differing: Differences, command: str
) -> dict[str, Any]:
    """Write `table.json`, `results.md` and `report/index.html` of all that is scored.

    Args:
        config: The benchmark.
        out: Its folder.
        differing: How its test queries differ from the frozen ones.
        command: What was called, for the page.

    Returns:
        The table, as in `table.json`.
    """
    work = Workspace(out)
    rows = finished_rows(config, work)
    document = table_document(config, work, rows)
    write_json(out / "table.json", document)
    text = results_page(config, work, rows, differing, command)
    (out / "results.md").write_text(text, encoding="utf-8")
    report = out / "report" / "index.html"
    report.parent.mkdir(parents=True, exist_ok=True)
    write_file(report, report_page(config, work, rows))
    return document


def results_page(
    config: BenchmarkConfig,
    work: Workspace,
    rows: Sequence[Row],
    differing: Differences,
    command: str,
) -> str:
    """Return the tables as Markdown; arguments as in `write_results`."""
    return render_page(
        "results.md.j2",
        package=_TEMPLATES,
        config=config,
        command=command,
        machines=_machines(work),
        differing=differing,
        sizes=" and ".join({f"{made.width}x{made.height}": 0 for made in config.sets.values()}),
        missing=_missing(config, rows),
        costs=cost_tables(config, work),
        **_tables(config, work, rows),
    )


def report_page(config: BenchmarkConfig, work: Workspace, rows: Sequence[Row]) -> str:
    """Return the tables with pictures, as one HTML page."""
    return render_page(
        "report.html.j2",
        package=_TEMPLATES,
        title=f"{config.name} {config.version}",
        opening=opening(config, work, rows),
        pictures=set_pictures(config, work, rows),
        controls=CONTROLS,
        report_of=lambda row: _report(work, row),
        **_tables(config, work, rows),
    )


def _tables(config: BenchmarkConfig, work: Workspace, rows: Sequence[Row]) -> dict[str, Any]:
    return {
        "paper": paper_tables(config, rows),
        "tracks": score_tables(config, rows),
        "comparisons": comparison_table(config, work, rows),
    }


def _report(work: Workspace, row: Row) -> str:
    """Return the path of a row's own report from the benchmark's; empty for a mean of seeds."""
    if row.seeds > 1:
        return ""
    protocol = next(iter(row.scores))
    folder = work.scores_path(row.set, row.entry.stored, protocol).relative_to(work.root)
    return f"../{folder.as_posix()}/report.html"


def _machines(work: Workspace) -> dict[str, int]:
    machines: dict[str, int] = {}
    for note in work.notes().values():
        machines[note["machine"]] = max(note["cores"], machines.get(note["machine"], 0))
    return machines


def _missing(config: BenchmarkConfig, rows: Sequence[Row]) -> dict[str, str]:
    """Return what the config names and has not been run: test and variant -> what lacks."""
    there = {(row.test, row.variant, row.entry) for row in rows}
    found: dict[str, str] = {}
    for key, test in config.tests.items():
        for variant in test.variants:
            lacking = [each for each in test.entries if (key, variant, each) not in there]
            parts = []
            for track in test.tracks:
                mine = [each for each in lacking if each.track == track]
                names = [each.method + " (blank)" * each.is_blank for each in mine]
                if len(names) == sum(each.track == track for each in test.entries):
                    names = ["all"]
                if names:
                    parts.append(f"{TRACKS[track]}: {', '.join(names)}")
            if parts:
                whole = len(lacking) == len(test.entries)
                found[test.heading(variant)] = "all" if whole else "; ".join(parts)
    return found


def rmse_by_tier(config: BenchmarkConfig, rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Return tier -> method -> RMSE in px by protocol `standard`."""
    found: dict[str, dict[str, float]] = {}
    for row in rows:
        value = row.value("standard", "rmse_px")
        if value is not None:
            name = f"{row.method}, blank picture" if row.entry.is_blank else row.method
            found.setdefault(config.tests[row.test].tier, {})[name] = value
    return found
