"""`pliant compare`: paired differences between reports."""

from __future__ import annotations

import json
from pathlib import Path

import click


@click.command("compare")
@click.argument(
    "reports", metavar="REPORT REPORT…", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "--metric",
    "metrics",
    multiple=True,
    metavar="NAME",
    help="An averaged metric of the protocol; may be repeated. Default: those of its headline.",
)
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON document on stdout.")
def command(reports: tuple[Path, ...], metrics: tuple[str, ...], as_json: bool) -> int:
    """Hold report folders of one protocol, dataset and split against each other.

    Differences come with intervals from resampling whole sequences, the same draws for both; a
    verdict needs an interval that excludes zero.
    """
    from pliant.evaluator.comparison import differences, method_names, ranks
    from pliant.evaluator.leaderboard import read_reports
    from pliant.evaluator.wording import about, label, written, written_unit
    from pliant.spec.errors import CallError

    scores = read_reports(reports)
    if len(scores) < 2:
        raise CallError("a comparison needs two reports", found=len(scores))
    found = differences(scores, metrics or None)
    names = method_names(scores)
    standing = ranks(found, names)
    protocol = str(scores[0].document["protocol"])
    if as_json:
        document = {
            "protocol": protocol,
            "methods": names,
            "differences": [item.as_dict() for item in found],
            "ranks": [
                {"group": group, "metric": metric, "ranks": dict(zip(names, places, strict=True))}
                for (group, metric), places in standing.items()
            ],
        }
        click.echo(json.dumps(document, indent=1))
        return 0
    last = ("", "")
    one_tier = len({item.group for item in found} - {"overall"}) == 1
    for item in found:
        if one_tier and item.group != "overall":
            continue  # the same figures once more
        _, unit, _ = about(item.metric, protocol)
        if (item.metric, item.group) != last:
            last = (item.metric, item.group)
            shown = written_unit(unit)
            click.echo(f"{label(item.metric)}{f' ({shown})' if shown else ''}, {item.group}")
        low, high = (written(None if x != x else x, unit) for x in (item.low, item.high))
        sign = "+" if item.value > 0 else ""
        click.echo(
            f"  {item.method} against {item.against}: {sign}{written(item.value, unit)} "
            f"[{low}, {high}]: {item.verdict}"
        )
    for (group, metric), places in standing.items():
        if group == "overall":
            order = sorted(zip(places, names, strict=True))
            text = ", ".join(f"{place}. {name}" for place, name in order)
            click.echo(f"Ranks by {label(metric)}: {text}")
    return 0
