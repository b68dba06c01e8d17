"""`pliant compare`: paired differences between reports."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pliant.cli.options import json_option, reports_argument
from pliant.cli.terminal import echo, echo_json
from pliant.spec.text import plural

if TYPE_CHECKING:
    from pliant.evaluator.comparison import Difference
    from pliant.evaluator.scores import Scores


@click.command("compare")
@reports_argument
@click.option(
    "--metric",
    "metrics",
    multiple=True,
    metavar="NAME",
    help="An averaged metric of the protocol; may be repeated. Default: those of its headline, or "
    "all if it has none there.",
)
@json_option
def command(reports: tuple[Path, ...], metrics: tuple[str, ...], as_json: bool) -> None:
    """Compare report folders of one protocol, dataset and split.

    Methods are compared sequence by sequence with a sign-flip test. A verdict needs an interval
    that excludes zero and at least 6 sequences; with fewer, only the order is shown. Each line
    ends with the number of sequences that a verdict on this difference would need.
    """
    from pliant.evaluator.comparison import differences, method_names, ranks
    from pliant.evaluator.protocols.protocol import ratios_of
    from pliant.evaluator.report.cells import heading
    from pliant.evaluator.report.leaderboard import read_reports
    from pliant.evaluator.statistics.sign_flips import fewest_sequences
    from pliant.spec.errors import CallError

    scores = read_reports(reports)
    if len(scores) < 2:
        raise CallError("a comparison needs two reports", found=len(scores))
    found = differences(scores, metrics or None)
    names = method_names(scores)
    standing = ranks(found, names)
    document = scores[0].document
    fewest = fewest_sequences(float(document["intervals"]["level"]))
    if as_json:
        result: dict[str, Any] = {
            "protocol": document["protocol"],
            "fewest_sequences": fewest,
            "methods": names,
            "differences": [item.as_dict() for item in found],
            "ranks": [
                {"group": group, "metric": metric, "ranks": dict(zip(names, places, strict=True))}
                for (group, metric), places in standing.items()
            ],
        }
        echo_json(result)
        return
    _print_differences(scores, names, found, fewest)
    compared = {item.metric for item in found}
    asked = dict.fromkeys(metrics or document["headline"])
    if lost := [m for m in asked if m in ratios_of(document) and m not in compared]:
        labels = "; ".join(heading(metric, document).label for metric in lost)
        echo(f"Not compared, because fewer than two methods have a value: {labels}.")
    for (group, metric), places in standing.items():
        placed = [each for each in zip(places, names, strict=True) if each[0] is not None]
        if group == "overall" and any(place != 1 for place, _ in placed):
            text = ", ".join(f"{place}. {name}" for place, name in sorted(placed))
            echo(f"Ranks by {heading(metric, document).label}: {text}")


def _print_differences(
    scores: Sequence[Scores], names: Sequence[str], found: Sequence[Difference], fewest: int
) -> None:
    """Print each difference, or only the order of the methods where there is no verdict."""
    from pliant.evaluator.report.cells import heading

    without: list[Difference] = []
    tables: dict[tuple[str, str], list[Difference]] = {}
    one_tier = len(scores[0].tiers) == 1
    for item in found:
        if item.group == "overall" or not one_tier:  # else the same figures once more
            tables.setdefault((item.metric, item.group), []).append(item)
    for (metric, group), items in tables.items():
        shown = heading(metric, scores[0].document)
        title = f"{shown.in_text}, {group}"
        if all(item.verdict == "too few sequences" for item in items):
            without += items
            order = ", ".join(_in_order(scores, names, items[0]))
            first = "lowest" if shown.better == "neither" else "best"
            echo(f"{title}, {first} first: {order}")
            continue
        echo(title if shown.better == "neither" else f"{title}, {shown.better} is better")
        for item in items:
            interval = ""
            if item.low == item.low:
                interval = f" [{shown.written(item.low)}, {shown.written(item.high)}]"
            value = f"{'+' if item.value > 0 else ''}{shown.written(item.value)}"
            counted = plural(item.sequences, "sequence")
            verdict = ""
            if shown.better != "neither":
                verdict = f": {item.verdict}"
                if item.verdict == "no clear difference" and item.sequences_needed is not None:
                    counted += f"; about {item.sequences_needed:,} would separate them"
            echo(f"  {item.method} against {item.against}: {value}{interval}{verdict} ({counted})")
    if without:
        most = max(item.sequences for item in without)
        needed = max(item.sequences_needed or fewest for item in without)
        echo(
            f"No verdict on {plural(len(without), 'difference')}: {plural(most, 'sequence')}, and "
            f"at least {fewest} are needed (about {needed:,} for all of them)."
        )


def _in_order(scores: Sequence[Scores], names: Sequence[str], item: Difference) -> list[str]:
    """Return the methods, best first, with their scores by the metric and group of a difference."""
    from pliant.evaluator.report.cells import heading

    shown = heading(item.metric, scores[0].document)
    groups = [
        each.overall if item.group == "overall" else each.tiers[item.group] for each in scores
    ]
    values = [(name, group.get(item.metric)) for name, group in zip(names, groups, strict=True)]
    values.sort(key=lambda each: shown.rank_key(each[1]))
    return [name if value is None else f"{name} {shown.written(value)}" for name, value in values]
