"""`pliant validate`: check a dataset against the specification."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.options import PATH, json_option
from pliant.cli.terminal import echo, echo_json, progress_bar
from pliant.spec.cores import cpu_cores
from pliant.spec.text import plural


@click.command()
@click.argument("data", metavar="DIR", type=PATH)
@click.option("--quick", is_flag=True, help="Structure, schemas and checksums only.")
@click.option(
    "--workers", type=click.IntRange(min=1), help="Worker processes; default: one per CPU core."
)
@click.option(
    "--limit",
    type=click.IntRange(min=1),
    default=200,
    show_default=True,
    help="Number of problems to list; the total is always given.",
)
@json_option
def command(
    data: Path,
    quick: bool,
    workers: int | None,
    limit: int,
    as_json: bool,
) -> int:
    """Check a dataset against the specification.

    Lists every problem with its code and place. Exit code 0: valid; 1: invalid; 2: folder not
    found.
    """
    from pliant.spec.validation.validate import validate

    with progress_bar("Validating", hidden=as_json) as bar:
        report = validate(
            data, quick=quick, workers=workers or cpu_cores(), limit=limit, progress=bar
        )
    if as_json:
        echo_json(report.as_dict())
        return 0 if report.valid else 1
    for issue in report.issues:
        echo(str(issue))
    kind = "quick check" if quick else "full check"
    scope = f"{plural(report.sequences, 'sequence')}, {plural(report.frames, 'frame')}, {kind}"
    if report.total == 0:
        echo(f"{data}: valid ({scope}).")
    else:
        if report.total > len(report.issues):
            echo(f"… {len(report.issues)} of {report.total} problems listed.")
        totals = ", ".join(f"{code} {count}" for code, count in report.counts.items())
        state = "valid, with warnings" if report.valid else "NOT valid"
        echo(f"{data}: {state} ({scope}): {plural(report.total, 'problem')}: {totals}.")
    return 0 if report.valid else 1
