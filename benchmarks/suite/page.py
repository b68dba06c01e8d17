"""The results page: Markdown, made from the table alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pliant.benchmarks.suite.checksums import Differences
from pliant.benchmarks.suite.config import BenchmarkConfig, Comparison
from pliant.benchmarks.suite.table import Row, best_classical, blocks
from pliant.benchmarks.suite.work import Cost, Workspace
from pliant.evaluator.report.cells import heading
from pliant.evaluator.scores import read_scores
from pliant.evaluator.statistics.comparison import differences

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
    "track": ("rmse_px_after_10", "rmse_px_after_20", "median_px", "jitter_px", "aj"),
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
        command: What was called, for the reader to call.
    """
    lines = [
        f"# Results of {config.name} {config.version}",
        "",
        f"Written by `{command}`; not edited by hand. {_machines(work)}",
        "",
        _standing(differing),
        "",
        "RMSE is in pixels at 640x480, pooled over the test split's queries whose point is seen in "
        "both frames, as the `paper` protocol does; in brackets its 95 % interval, by bootstrap "
        "over sequences. The other columns are those of the `standard` protocol (`track` for "
        "episodes); `docs/scoring.md` defines each. *Paper* is the figure printed in *Learning "
        "Correspondence for Deformable Objects*, on its own images; it did not say whether it "
        "pooled errors or averaged over pairs, so both stand here. CPU minutes are of all "
        "processes together; training includes what a run started from.",
        "",
        *[f"![{_caption(name)}]({name})" for name in figures],
    ]
    for key, variant, members in blocks(list(rows)):
        test = config.tests[key]
        title = test.title if len(test.variants) == 1 else f"{test.title}: {variant}"
        lines += ["", f"## {title}", "", *_block(members, test.protocols)]
    lines += ["", "## What one thing adds", "", *_comparisons(config, work, rows)]
    lines += ["", "## What it cost", "", *_costs(work, config)]
    return "\n".join(lines) + "\n"


def _standing(differing: Differences) -> str:
    if not differing.frozen:
        return "The test queries are not frozen yet: there are no checksums to hold them against."
    if not differing.sets:
        return "The test queries and their answers are the frozen ones: all checksums agree."
    listed = "; ".join(f"{name}: {what}" for name, what in differing.sets.items())
    warning = "The test queries are not the frozen ones, so these figures compare with no others."
    return f"**{warning}** {listed}."


def _machines(work: Workspace) -> str:
    cores: dict[str, int] = {}
    for note in work.notes().values():
        cores[note["machine"]] = max(note["cores"], cores.get(note["machine"], 0))
    listed = " and ".join(
        f"{count} {'core' if count == 1 else 'cores'} of {name}" for name, count in cores.items()
    )
    return f"Machine: {listed}."


def _block(members: Sequence[Row], protocols: Sequence[str]) -> list[str]:
    main = protocols[0]
    error = "paper" if "paper" in protocols else main
    metrics = [
        name
        for name in _METRICS[main]
        if any(row.value(main, name) is not None for row in members)
        and (name != _SYMMETRIC or any(_symmetric(row, main) for row in members))
    ]
    paper = any(row.paper_rmse_px is not None for row in members)
    heads = ["Method", "RMSE"]
    heads += ["Paper"] if paper else []
    heads += [
        *(heading(name, main).label for name in metrics),
        "Train, CPU min",
        "Answer, CPU s a pair",
    ]
    lines = ["| " + " | ".join(heads) + " |", "|---" + "|---:" * (len(heads) - 1) + "|"]
    for row in members:
        cells = [row.label, _with_interval(row, error, "rmse_px")]
        if paper:
            cells.append("" if row.paper_rmse_px is None else f"{row.paper_rmse_px:g}")
        cells += [_written(row.value(main, name), name) for name in metrics]
        cells.append("" if row.train is None else f"{row.train.cpu_s / 60:.1f}")
        cells.append(f"{row.predict_cpu_s / max(row.pairs, 1):.2f}")
        lines.append("| " + " | ".join(cells) + " |")
    best = best_classical(list(members), error)
    if best is not None:
        learned = [
            (value, row.label)
            for row in members
            if row.learned and (value := row.value(error, "rmse_px")) is not None
        ]
        lines += ["", f"Best of SIFT, SURF and ORB: {best:.1f} px."]
        if learned:
            value, name = min(learned)
            lines[-1] += f" Best learned method: {name}, {value:.1f} px, {value / best:.2f} of it."
    return lines


def _symmetric(row: Row, protocol: str) -> bool:
    """Return whether symmetry makes a difference to a row: most tiers have none."""
    return row.value(protocol, _SYMMETRIC) != row.value(protocol, "rmse_px")


def _with_interval(row: Row, protocol: str, metric: str) -> str:
    value, interval = row.value(protocol, metric), row.interval(protocol, metric)
    if value is None:
        return ""
    return f"{value:.1f}" + ("" if interval is None else f" [{interval[0]:.1f}, {interval[1]:.1f}]")


def _written(value: float | None, metric: str) -> str:
    if value is None:
        return ""
    return (
        f"{value:.1f}" if metric.endswith("px") and not metric.startswith("pck") else f"{value:.3f}"
    )


def _comparisons(config: BenchmarkConfig, work: Workspace, rows: Sequence[Row]) -> list[str]:
    lines = [
        "| Question | Method | Against | Metric | Difference | Verdict |",
        "|---|---|---|---|---:|---|",
    ]
    scored = {(row.set, row.method): row for row in rows}
    for each in config.comparisons:
        first, second = scored.get((each.set, each.method)), scored.get((each.set, each.against))
        if first is None or second is None:
            continue
        lines.append(_comparison(config, work, each, first, second))
    return lines


def _comparison(
    config: BenchmarkConfig, work: Workspace, asked: Comparison, first: Row, second: Row
) -> str:
    protocol = config.tests[first.test].protocols[0]
    reports = [
        read_scores(work.scores_path(asked.set, name, protocol))
        for name in (asked.against, asked.method)
    ]
    found = next(
        (
            each
            for each in differences(reports, [asked.metric])
            if each.group == "overall" and each.method == asked.method
        ),
        None,
    )
    before, after = second.value(protocol, asked.metric), first.value(protocol, asked.metric)
    if found is None or before is None or after is None:
        return f"| {asked.question} | {first.label} | {second.label} | {asked.metric} | | none |"
    digits = 1 if asked.metric.endswith("px") else 3
    difference = f"{found.value:+.{digits}f}"
    if found.verdict != "too few sequences":
        difference += f" [{found.low:+.{digits}f}, {found.high:+.{digits}f}]"
    cells = (
        asked.question,
        f"{first.label}: {after:.{digits}f}",
        f"{second.label}: {before:.{digits}f}",
        f"{heading(asked.metric, protocol).label}, {asked.set}",
        difference,
        found.verdict,
    )
    return "| " + " | ".join(cells) + " |"


def _costs(work: Workspace, config: BenchmarkConfig) -> list[str]:
    def total(names: Mapping[str, str]) -> Cost:
        return sum((work.cost(stage) for stage in names.values()), Cost())

    answers = {
        f"{set_name}--{method}": f"answer/{set_name}--{method}"
        for test in config.tests.values()
        for set_name in test.variants.values()
        for method in test.answering
    }
    parts = {
        "making the sets": total({name: f"set/{name}" for name in config.sets}),
        "training": total({name: f"run/{name}" for name in config.runs}),
        "answering and scoring": total(answers),
    }
    lines = ["| Stage | CPU minutes |", "|---|---:|"]
    lines += [f"| {name} | {cost.cpu_s / 60:.1f} |" for name, cost in parts.items()]
    everything = sum(parts.values(), Cost())
    lines += [f"| together | {everything.cpu_s / 60:.1f} |", ""]
    lines += ["| Set | CPU minutes | Training | CPU minutes |", "|---|---:|---|---:|"]
    sets = [(name, work.cost(f"set/{name}").cpu_s) for name in config.sets]
    runs = [(name, work.cost(f"run/{name}").cpu_s) for name in config.runs]
    for index in range(max(len(sets), len(runs))):
        cells = []
        for column in (sets, runs):
            given = index < len(column)
            cells += [column[index][0], f"{column[index][1] / 60:.1f}"] if given else ["", ""]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _caption(name: str) -> str:
    return name.rsplit("/", 1)[-1].split(".")[0].replace("-", " ")
