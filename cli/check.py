"""`pliant check`: a submission's problems, without scoring it."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.options import PATH, data_option, json_option
from pliant.cli.terminal import echo, echo_json, terminated_like_interrupted
from pliant.spec.text import plural


@click.command("check")
@click.argument("submission", metavar="SUB.parquet", type=PATH)
@data_option("The dataset; its queries suffice.")
@click.option("--allow-missing", is_flag=True, help="Accept queries without an answer.")
@json_option
def command(submission: Path, data: Path, allow_missing: bool, as_json: bool) -> int:
    """List everything that is wrong with SUB.parquet.

    A file without problems can be scored. Exit code 0: no problems; 1: problems.
    """
    from pliant.evaluator import inspect
    from pliant.spec.io.parquet import read_footer
    from pliant.spec.limits import Limits

    with terminated_like_interrupted(""):
        problems = inspect(submission, data, allow_missing=allow_missing, limits=Limits())
    issues = problems.issues()
    if as_json:
        document = {
            "valid": not issues,
            "total": problems.total,
            "counts": problems.counts,
            "issues": [issue.as_dict() for issue in issues],
            "warnings": problems.hints,
        }
        echo_json(document)
    elif issues:
        for issue in problems.causes:
            echo(str(issue))
        counts = ", ".join(f"{code} {count:,}" for code, count in problems.counts.items())
        echo(f"{submission}: {plural(problems.total, 'problem')} ({counts}).")
    else:
        for hint in problems.hints:
            echo(f"Warning: {hint}")
        split = read_footer(submission)["split"]
        echo(f"{submission}: nothing is wrong; split {split} can be scored.")
    return 1 if issues else 0
