"""`pliant validate`: check a dataset against the specification."""

from __future__ import annotations

import json
from pathlib import Path

import click

from pliant.cli.terminal import echo


@click.command()
@click.argument("data", metavar="DIR", type=click.Path(path_type=Path))
@click.option("--quick", is_flag=True, help="Structure, schemas and checksums only.")
@click.option(
    "--workers", type=click.IntRange(min=1), default=None, help="Processes; default: all cores."
)
@click.option(
    "--limit",
    type=click.IntRange(min=1),
    default=200,
    show_default=True,
    help="List so many problems; the total is told in any case.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(data: Path, quick: bool, workers: int | None, limit: int, as_json: bool) -> int:
    """Check a dataset against the specification.

    Lists every problem with its code and place. Exit code 0: valid; 1: not; 2: no such folder.
    """
    import os

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    from pliant.spec.validation.validate import validate

    if workers is None:
        workers = len(os.sched_getaffinity(0))
    columns = ("Validating", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=as_json) as bar:
        task = bar.add_task("", total=None)
        report = validate(
            data,
            quick=quick,
            workers=workers,
            limit=limit,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    if as_json:
        echo(json.dumps(report.as_dict(), indent=1))
        return 0 if report.valid else 1
    for issue in report.issues:
        echo(str(issue))
    kind = "quick check" if quick else "full check"
    scope = f"{report.sequences} sequences, {report.frames} frames, {kind}"
    if report.total == 0:
        echo(f"{data}: valid ({scope}).")
    else:
        if report.total > len(report.issues):
            echo(f"… {len(report.issues)} of {report.total} problems listed.")
        totals = ", ".join(f"{code} {count}" for code, count in report.counts.items())
        state = "valid, with warnings" if report.valid else "NOT valid"
        echo(f"{data}: {state} ({scope}): {report.total} problems: {totals}.")
    return 0 if report.valid else 1
