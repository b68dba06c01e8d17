"""`pliant evaluate`: score a submission by a named protocol."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pliant.cli.terminal import echo

if TYPE_CHECKING:
    from pliant.evaluator import Scores


@click.command("evaluate")
@click.argument("submission", metavar="SUB.parquet", type=click.Path(path_type=Path))
@click.option(
    "--data", required=True, metavar="DIR", type=click.Path(path_type=Path), help="The dataset."
)
@click.option(
    "--truth",
    metavar="FILE|DIR",
    type=click.Path(path_type=Path),
    help="The split's truth, or `pliant publish`'s private half, where the dataset holds none.",
)
@click.option(
    "--protocol",
    default=None,
    metavar="NAME",
    help="paper, standard, tapvid, track or matches; default: standard, and matches for matches.",
)
@click.option("--out", metavar="REPORT", type=click.Path(path_type=Path), help="Report folder.")
@click.option(
    "--allow-missing",
    is_flag=True,
    help="Score a missing answer as the worst value in every metric; print the coverage.",
)
@click.option(
    "--hide-truth",
    is_flag=True,
    help="Cap every error at the image diagonal, for results shown to participants "
    "(see: pliant serve --hide-truth).",
)
@click.option("--json", "as_json", is_flag=True, help="Print scores.json on stdout.")
def command(
    submission: Path,
    data: Path,
    truth: Path | None,
    protocol: str | None,
    out: Path | None,
    allow_missing: bool,
    hide_truth: bool,
    as_json: bool,
) -> int:
    """Score SUB.parquet against its dataset.

    Writes scores.json, per_pair.parquet and report.html into REPORT. A submission with anything
    wrong in it is refused with every reason, exit code 1.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    from pliant.evaluator import evaluate, write_report
    from pliant.spec.errors import SubmissionError

    if out is not None:
        from pliant.evaluator.report.report import check_out_dir

        check_out_dir(out)
    columns = ("Scoring", BarColumn(), MofNCompleteColumn(), "pairs", TimeRemainingColumn())
    console = Console(stderr=True)
    try:
        with Progress(*columns, console=console, transient=True, disable=as_json) as bar:
            task = bar.add_task("", total=None)
            scores = evaluate(
                submission,
                data,
                truth=truth,
                protocol=protocol,
                allow_missing=allow_missing,
                hide_truth=hide_truth,
                progress=lambda done, total: bar.update(task, completed=done, total=total),
            )
    except SubmissionError as error:
        for issue in error.issues:
            echo(str(issue), err=True)
        raise
    for hint in scores.hints:
        echo(f"Warning: {hint}", err=True)
    if out is not None:
        write_report(scores, out, data=data)
    if as_json:
        echo(json.dumps(scores.document, indent=1, sort_keys=True))
    else:
        _print(scores, out)
    return 0


def _print(scores: Scores, out: Path | None) -> None:
    """Print the headline table."""
    from pliant.evaluator.report.cells import heading, score_cell

    document = scores.document
    dataset = document["dataset"]
    echo(
        f"{scores.method} on {dataset['id']} {dataset['version']}, split {document['split']}, "
        f"protocol {document['protocol']} {document['protocol_version']}"
    )
    if document["coverage"] < 1:
        echo(f"Coverage: {document['coverage'] * 100:.2f} %")
    # Of one tier, the whole and the tier are the same figures.
    groups = ["overall", *(scores.tiers if len(scores.tiers) > 1 else ())]
    width = max(len(name) for name in groups)
    for metric in document["headline"]:
        shown = [(group, score_cell(document, group, metric)) for group in groups]
        cells = "  ".join(
            f"{group:>{width}} {cell.value:>8} {cell.coverage}".rstrip() for group, cell in shown
        )
        echo(f"  {heading(metric, document['protocol']).in_text:32} {cells}")
    for name, note in document["notes"].items():
        echo(f"Note, {name}: {note}", err=True)
    if out is not None:
        echo(f"Report: {out / 'report.html'}")
