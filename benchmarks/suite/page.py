"""The results page: Markdown, made from the table alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any

import pyarrow as pa

from pliant.benchmarks.suite.cause_tables import cause_tables
from pliant.benchmarks.suite.checksums import Differences
from pliant.benchmarks.suite.config import BenchmarkConfig, Comparison
from pliant.benchmarks.suite.table import Row, arms, best_untrained, blocks
from pliant.benchmarks.suite.work import Cost, Workspace
from pliant.evaluator.comparison import Difference, differences
from pliant.evaluator.protocols.protocol import read_protocol
from pliant.evaluator.report.cells import heading
from pliant.evaluator.report.pages import render_page
from pliant.evaluator.scores import Scores, read_scores

_SYMMETRIC = "symmetric_rmse_px"
_METRICS = {
    "standard": (
        "rmse_px_mean_over_pairs",
        "median_px",
        "pck_8px",
        _SYMMETRIC,
        "jump_rate",
        "nll",
        "ece",
    ),
    "track": (
        "rmse_px_after_1",
        "rmse_px_after_5",
        "rmse_px_after_15",
        "rmse_px_moving",
        "median_px",
        "jitter_px",
        "aj",
    ),
}


def results_page(
    config: BenchmarkConfig,
    work: Workspace,
    rows: Sequence[Row],
    differing: Differences,
    figures: Sequence[str],
    command: str,
) -> str:
    """Return the page.

    Args:
        config: The benchmark.
        work: Its folder.
        rows: The table.
        differing: How the test queries differ from the frozen ones.
        figures: Paths of the figures, relative to the page.
        command: The command that makes it.
    """
    machines: dict[str, int] = {}
    for note in work.notes().values():
        machines[note["machine"]] = max(note["cores"], machines.get(note["machine"], 0))
    return render_page(
        "results.md.j2",
        package="pliant.benchmarks.suite",
        config=config,
        command=command,
        machines=machines,
        differing=differing,
        sizes=" and ".join({f"{made.width}x{made.height}": 0 for made in config.sets.values()}),
        figures=figures,
        rows=len(rows),
        asked=sum(len(test.variants) * len(test.answering) for test in config.tests.values()),
        blocks=[
            _block(config, key, variant, arms(members))
            for key, variant, members in blocks(list(rows))
        ],
        causes=cause_tables(config, work, rows),
        comparisons=_comparisons(config, work, rows),
        **_costs(work, config),
    )


def _block(
    config: BenchmarkConfig, key: str, variant: str, members: Sequence[Row]
) -> dict[str, Any]:
    test = config.tests[key]
    main = test.protocols[0]
    error = "paper" if "paper" in test.protocols else main
    metrics = [
        name
        for name in (*_METRICS.get(main, read_protocol(main).headline), *test.figures)
        if name != "rmse_px"
        and any(row.value(main, name) is not None for row in members)
        and (name != _SYMMETRIC or any(_symmetric(row, main) for row in members))
    ]
    paper = any(row.paper_rmse_px is not None for row in members)
    lines = []
    for row in members:
        cells = [row.label, _with_interval(row, error, "rmse_px")]
        if paper:
            cells.append("" if row.paper_rmse_px is None else f"{row.paper_rmse_px:g}")
        cells += [_written(row.value(main, name), _digits(name, main)) for name in metrics]
        cells.append("" if row.train is None else f"{row.train.cpu_s / 60:.1f}")
        cells.append(f"{row.predict_cpu_s / max(row.pairs, 1):.2f}")
        lines.append(cells)
    learned = [
        (value, row.label)
        for row in members
        if row.learned and (value := row.value(error, "rmse_px")) is not None
    ]
    untrained = best_untrained(members, error)
    return {
        "title": test.title if len(test.variants) == 1 else f"{test.title}: {variant}",
        "heads": [
            *("Method", "RMSE"),
            *(["Paper"] if paper else []),
            *(heading(name, main).label for name in metrics),
            *("Train, CPU min", "Answer, CPU s per pair"),
        ],
        "rows": lines,
        "untrained": untrained and (untrained.value(error, "rmse_px"), untrained.label),
        "learned": min(learned, default=None),
    }


def _symmetric(row: Row, protocol: str) -> bool:
    """Return whether symmetry makes a difference to a row: most tiers have none."""
    return row.value(protocol, _SYMMETRIC) != row.value(protocol, "rmse_px")


def _with_interval(row: Row, protocol: str, metric: str) -> str:
    value, interval = row.value(protocol, metric), row.interval(protocol, metric)
    if value is None:
        return ""
    return f"{value:.1f}" + ("" if interval is None else f" [{interval[0]:.1f}, {interval[1]:.1f}]")


def _written(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _digits(metric: str, protocol: str) -> int:
    """Return how many digits after the point a metric is shown with: fewer for pixels."""
    return 1 if heading(metric, protocol).stored_unit == "px" else 3


def _comparisons(
    config: BenchmarkConfig, work: Workspace, rows: Sequence[Row]
) -> list[Sequence[str]]:
    given = [row for row in rows if config.tests[row.test].masks]
    scored = {(row.set, row.arm): row for row in arms(given)}
    pairs = [
        (each, scored.get((each.set, each.method)), scored.get((each.set, each.against)))
        for each in config.comparisons
    ]
    return [
        _comparison(config, work, each, first, second)
        for each, first, second in pairs
        if first is not None and second is not None
    ]


def _comparison(
    config: BenchmarkConfig, work: Workspace, asked: Comparison, first: Row, second: Row
) -> Sequence[str]:
    protocol = config.tests[first.test].protocols[0]
    metric = asked.metric
    seeds = max(first.seeds, second.seeds)
    judged, against = (
        _reports(config, work, asked.set, name, protocol, seeds)
        for name in (asked.method, asked.against)
    )
    found = _difference(_pooled(against), _pooled(judged), metric)
    before, after = second.value(protocol, metric), first.value(protocol, metric)
    if found is None or before is None or after is None:
        return (asked.question, first.label, second.label, metric, "", "none")
    digits = _digits(metric, protocol)
    difference = f"{found.value:+.{digits}f}"
    if found.verdict != "too few sequences":
        difference += f" [{found.low:+.{digits}f}, {found.high:+.{digits}f}]"
    verdict: str = found.verdict
    if verdict in ("better", "worse") and seeds > 1:
        single = [_difference(b, a, metric) for a, b in zip(judged, against, strict=True)]
        if any(each is None or each.value * found.value <= 0 for each in single):
            verdict = "no clear difference: the seeds disagree"
    return (
        asked.question,
        f"{first.label}: {after:.{digits}f}",
        f"{second.label}: {before:.{digits}f}",
        f"{heading(metric, protocol).label}, {asked.set}",
        difference,
        verdict,
    )


def _reports(
    config: BenchmarkConfig, work: Workspace, asked: str, name: str, protocol: str, seeds: int
) -> list[Scores]:
    """Return the reports of an arm, one per seed; that of a method without seeds is repeated."""
    found = [read_scores(work.scores_path(asked, each, protocol)) for each in config.members(name)]
    return found * seeds if len(found) == 1 else found


def _pooled(reports: Sequence[Scores]) -> Scores:
    """Return the answers of all seeds as one report: a sequence stays one cluster."""
    return replace(reports[0], per_pair=pa.concat_tables([each.per_pair for each in reports]))


def _difference(against: Scores, judged: Scores, metric: str) -> Difference | None:
    """Return the paired difference over all tiers, None where the metric is not defined."""
    found = differences([against, judged], [metric])
    return next((each for each in found if each.group == "overall"), None)


def _costs(work: Workspace, config: BenchmarkConfig) -> dict[str, Any]:
    """Return CPU minutes of the stages, and of each set and training."""
    answers = {
        f"answer/{set_name}--{test.stored(method)}": None
        for test in config.tests.values()
        for set_name in test.variants.values()
        for method in test.answering
    }
    parts: dict[str, Mapping[str, str | None]] = {
        "making the sets": {f"set/{name}": name for name in config.sets},
        "training": {f"run/{name}": name for name in config.runs},
        "answering and scoring": answers,
    }

    def minutes(stages: Iterable[str]) -> str:
        return f"{sum((work.cost(stage) for stage in stages), Cost()).cpu_s / 60:.1f}"

    stages = [(name, minutes(own)) for name, own in parts.items()]
    stages.append(("together", minutes([stage for own in parts.values() for stage in own])))
    sets, runs = (
        [(name, minutes([stage])) for stage, name in parts[part].items()]
        for part in ("making the sets", "training")
    )
    return {"stages": stages, "costs": list(zip_longest(sets, runs, fillvalue=("", "")))}
