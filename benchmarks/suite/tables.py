"""The tables of a benchmark as headings and cells: the page and the report show the same ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Final

import pyarrow as pa

from pliant.benchmarks.suite.config import TRACKS, BenchmarkConfig, Comparison
from pliant.benchmarks.suite.table import CLASSICAL, Row, arms, best, blocks, paper_name
from pliant.benchmarks.suite.work import Cost, Workspace
from pliant.evaluator.comparison import Difference, differences
from pliant.evaluator.protocols.protocol import read_protocol
from pliant.evaluator.scores import Scores, read_scores
from pliant.evaluator.statistics.ratios import Figure

_SYMMETRIC: Final = "symmetric_rmse_px"
_COLUMNS: Final = {
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
"""Protocol -> the columns after RMSE."""

_PAPER_ROWS: Final = {
    **{name: name.upper() for name in CLASSICAL},
    "contrastive": "contrastive",
    "distributional": "distributional",
}


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        title: Its heading.
        heads: Names of the columns, methods first.
        rows: Cells, formatted.
        methods: The scores behind the rows, where they are methods.
        note: A sentence below it, or empty.
    """

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    methods: Sequence[Row] = ()
    note: str = ""


def score_tables(config: BenchmarkConfig, rows: Sequence[Row]) -> dict[str, list[Table]]:
    """Return the tables of every track, the headline first: name of the track -> tables."""
    found: dict[str, list[Table]] = {}
    for block in blocks(config, rows):
        track = TRACKS[block[0].entry.track]
        found.setdefault(track, []).append(_score_table(config, block))
    return found


def _score_table(config: BenchmarkConfig, rows: Sequence[Row]) -> Table:
    test = config.tests[rows[0].test]
    protocol = test.protocols[0]
    columns = [
        name
        for name in (*_COLUMNS.get(protocol, read_protocol(protocol).headline), *test.figures)
        if name != "rmse_px"
        and any(row.value(protocol, name) is not None for row in rows)
        and (name != _SYMMETRIC or any(_has_symmetry(row, protocol) for row in rows))
    ]
    paper = any(row.paper_rmse_px is not None for row in rows)
    matches = any("matches" in row.scores for row in rows)
    training = any(row.train is not None for row in rows)
    lines = [
        [
            row.label,
            _with_interval(row, protocol, "rmse_px"),
            *(["" if row.paper_rmse_px is None else f"{row.paper_rmse_px:g}"] * paper),
            *(_with_interval(row, protocol, _SYMMETRIC) if name == _SYMMETRIC
              else _written(row.value(protocol, name), _digits(name, protocol))
              for name in columns),
            *([_with_interval(row, "matches", "rmse_px")] * matches),
            *(["" if row.train is None else f"{row.train.cpu_s / 60:.1f}"] * training),
            f"{row.predict_cpu_s / max(row.pairs, 1):.2f}",
        ]
        for row in rows
    ]  # fmt: skip
    heads = [
        "Method",
        "RMSE",
        *(["Paper"] * paper),
        *(_figure(name, protocol).title for name in columns),
        *(["RMSE of own matches"] * matches),
        *(["Train, CPU min"] * training),
        "Answer, CPU s per pair",
    ]
    best = _best_sentence(rows, protocol)
    return Table(test.heading(rows[0].variant), heads, lines, rows, best)


def _best_sentence(rows: Sequence[Row], protocol: str) -> str:
    """Return which row without learning and which learned one is best, by both errors."""
    shown = [_SYMMETRIC] if any(_has_symmetry(row, protocol) for row in rows) else []
    sentences = []
    for metric in ["rmse_px", *shown]:
        parts = []
        for learned, words in ((False, "without learning"), (True, "learned")):
            row = best(rows, protocol, metric, learned=learned)
            if row is not None:
                parts.append(f"{words} {row.label}, {row.value(protocol, metric):.1f} px")
        if parts:
            name = "" if metric == "rmse_px" else " symmetry-aware"
            sentences.append(f"Best{name}: {'; '.join(parts)}.")
    return " ".join(sentences)


def paper_tables(config: BenchmarkConfig, rows: Sequence[Row]) -> list[Table]:
    """Return the paper's table, one for each of its datasets, with its figures in a column."""
    tables = []
    for key, test in config.tests.items():
        if not test.paper_rmse_px:
            continue
        variant = next(iter(test.variants))
        mine = [row for row in arms(rows) if (row.test, row.variant) == (key, variant)]
        lines = []
        for name, label in _PAPER_ROWS.items():
            found = {
                row.entry.track: row
                for row in mine
                if paper_name(row.arm) == name and not row.entry.is_blank
            }
            cells = [_rmse(found.get(track), "standard") for track in TRACKS]
            own = _rmse(found.get("none"), "matches") if name in CLASSICAL else ""
            lines.append([label, f"{test.paper_rmse_px[name]:g}", *cells, own])
        heads = ["Method", "Paper", *TRACKS.values(), "own matches, image alone"]
        tables.append(Table(test.title, heads, lines))
    return tables


def _rmse(row: Row | None, protocol: str) -> str:
    return "not run" if row is None else _with_interval(row, protocol, "rmse_px") or "none"


def comparison_table(config: BenchmarkConfig, work: Workspace, rows: Sequence[Row]) -> Table | None:
    """Return the paired differences that the config asks for, None where none can be answered."""
    scored = {
        (row.set, row.arm, row.entry.track): row for row in arms(rows) if not row.entry.is_blank
    }
    lines = []
    for asked in config.comparisons:
        judged = scored.get((asked.set, asked.method, asked.track))
        against = scored.get((asked.set, asked.against, asked.track))
        if judged is not None and against is not None:
            lines.append(_comparison(config, work, asked, judged, against))
    heads = ["Question", "Method", "Against", "Metric", "Difference", "Verdict"]
    return Table("What one thing adds", heads, lines) if lines else None


def _comparison(
    config: BenchmarkConfig, work: Workspace, asked: Comparison, first: Row, second: Row
) -> Sequence[str]:
    protocol, metric = config.tests[first.test].protocols[0], asked.metric
    seeds = max(first.seeds, second.seeds)
    judged, against = (_reports(config, work, row, protocol, seeds) for row in (first, second))
    found = _difference(_pooled(against), _pooled(judged), metric)
    before, after = second.value(protocol, metric), first.value(protocol, metric)
    place = f"{_figure(metric, protocol).title}, {asked.set}, {TRACKS[asked.track]}"
    if found is None or before is None or after is None:
        return (asked.question, first.label, second.label, place, "", "none")
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
        place,
        difference,
        verdict,
    )


def _reports(
    config: BenchmarkConfig, work: Workspace, row: Row, protocol: str, seeds: int
) -> list[Scores]:
    """Return the reports of an arm, one per seed; that of a method without seeds is repeated."""
    found = [
        read_scores(work.scores_path(row.set, replace(row.entry, method=each).stored, protocol))
        for each in config.members(row.arm)
    ]
    return found * seeds if len(found) == 1 else found


def _pooled(reports: Sequence[Scores]) -> Scores:
    """Return the answers of all seeds as one report."""
    return replace(reports[0], per_pair=pa.concat_tables([each.per_pair for each in reports]))


def _difference(against: Scores, judged: Scores, metric: str) -> Difference | None:
    """Return the paired difference over all tiers, None where the metric is not defined."""
    found = differences([against, judged], [metric])
    return next((each for each in found if each.group == "overall"), None)


def cost_tables(config: BenchmarkConfig, work: Workspace) -> list[Table]:
    """Return CPU minutes of the stages, and of each set and training."""
    stages = {
        "making the sets": [f"set/{name}" for name in config.sets],
        "training": [f"run/{name}" for name in config.runs],
        "answering and scoring": sorted({each.stage for each in config.answers}),
    }
    costs = {
        name: [(each.partition("/")[2], work.cost(each)) for each in mine]
        for name, mine in stages.items()
    }
    lines = [[name, _minutes([cost for _, cost in mine])] for name, mine in costs.items()]
    lines.append(["together", _minutes([cost for mine in costs.values() for _, cost in mine])])
    parts = [
        [(name, _minutes([cost])) for name, cost in costs[stage] if cost.cpu_s]
        for stage in ("making the sets", "training")
    ]
    each = [[*a, *b] for a, b in zip_longest(*parts, fillvalue=("", ""))]
    return [
        Table("", ["Stage", "CPU minutes"], lines),
        Table("", ["Set", "CPU minutes", "Training", "CPU minutes"], each),
    ]


def _minutes(costs: Sequence[Cost]) -> str:
    return f"{sum(costs, Cost()).cpu_s / 60:.1f}"


def _has_symmetry(row: Row, protocol: str) -> bool:
    """Return whether symmetry makes a difference to a row: most tiers have none."""
    return row.value(protocol, _SYMMETRIC) not in (None, row.value(protocol, "rmse_px"))


def _with_interval(row: Row, protocol: str, metric: str) -> str:
    value, interval = row.value(protocol, metric), row.interval(protocol, metric)
    if value is None:
        return ""
    return f"{value:.1f}" + ("" if interval is None else f" [{interval[0]:.1f}, {interval[1]:.1f}]")


def _written(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _digits(metric: str, protocol: str) -> int:
    """Return how many digits after the point a metric is shown with: fewer for pixels."""
    return 1 if _figure(metric, protocol).unit == "px" else 3


def _figure(metric: str, protocol: str) -> Figure:
    return read_protocol(protocol).figures[metric]
