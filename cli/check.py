"""`pliant check`: a submission's problems, without scoring it."""

from __future__ import annotations

import json
from pathlib import Path

import click

from pliant.cli.terminal import echo


@click.command("check")
@click.argument("submission", metavar="SUB.parquet", type=click.Path(path_type=Path))
@click.option(
    "--data",
    required=True,
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="The dataset; its queries suffice.",
)
@click.option("--allow-missing", is_flag=True, help="A query without an answer is no problem.")
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON document on stdout.")
def command(submission: Path, data: Path, allow_missing: bool, as_json: bool) -> int:
    """List everything that is wrong with SUB.parquet.

    What passes here can be scored. Exit code 0: nothing is wrong; 1: something is.
    """
    from pliant.evaluator import inspect

    problems = inspect(submission, data, allow_missing=allow_missing)
    issues = problems.issues()
    if as_json:
        document = {
            "valid": not issues,
            "total": problems.total,
            "counts": problems.totals,
            "issues": [issue.as_dict() for issue in issues],
            "warnings": problems.hints,
        }
        echo(json.dumps(document, indent=1))
    elif issues:
        for issue in issues:
            echo(str(issue))
        counts = ", ".join(f"{code} {count:,}" for code, count in problems.totals.items())
        noun = "problem" if problems.total == 1 else "problems"
        echo(f"{submission}: {problems.total:,} {noun} ({counts}).")
    else:
        for hint in problems.hints:
            echo(f"Warning: {hint}")
        echo(f"{submission}: nothing is wrong; it can be scored.")
    return 1 if issues else 0
