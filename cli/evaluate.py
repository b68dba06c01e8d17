"""`pliant evaluate`: score a submission by a named protocol."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pliant.cli.options import PATH, data_option, json_option, path_option, workers_option
from pliant.cli.terminal import echo, echo_json, progress_bar, terminated_like_interrupted
from pliant.spec.conventions import SPLITS

if TYPE_CHECKING:
    from pliant.evaluator import Scores


@click.command("evaluate")
@click.argument("submission", metavar="SUB.parquet", type=PATH)
@data_option("The dataset.")
@path_option(
    "--truth",
    "FILE|DIR",
    "The split's truth, its folder, or the private half of `pliant publish`.",
)
@click.option(
    "--protocol",
    default=None,
    metavar="NAME|FILE",
    help="paper, standard, tapvid, tapvid-first, tapvid-strided, track, auc, spair, matches, or "
    "the JSON or YAML file of another; default: standard, and matches for matches.",
)
@click.option(
    "--split",
    type=click.Choice(SPLITS),
    help="Refuse a submission for another split, such as one whose truth is public.",
)
@path_option("--out", "REPORT", "Report folder.")
@click.option(
    "--allow-missing",
    is_flag=True,
    help="Score a missing answer as the worst value in every metric; print the coverage.",
)
@click.option(
    "--hide-truth",
    is_flag=True,
    help="Cap every error at the image diagonal, and print what participants may see: rounded "
    "headline figures. REPORT is for the host (see: pliant leaderboard --hide-truth).",
)
@workers_option(" that read surface images")
@json_option
def command(
    submission: Path,
    data: Path,
    split: str | None,
    out: Path | None,
    hide_truth: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Score SUB.parquet against its dataset.

    Writes scores.json, per_pair.parquet and report.html into REPORT. A submission
    with problems is refused: all of them are listed, and the exit code is 1.
    """
    from pliant.evaluator import evaluate, write_report
    from pliant.evaluator.scores import public_scores
    from pliant.spec.errors import SubmissionError
    from pliant.spec.limits import Limits

    if out is not None:
        from pliant.evaluator.report.report import check_out_dir

        check_out_dir(out)
    with terminated_like_interrupted(""):
        try:
            with progress_bar("Scoring", "pairs", hidden=as_json) as bar:
                given |= {"hide_truth": hide_truth, "limits": Limits(), "progress": bar}
                scores = evaluate(submission, data, **given)
        except SubmissionError as error:
            for issue in error.issues:
                echo(str(issue), err=True)
            raise
        if split not in (None, found := scores.document["split"]):
            raise SubmissionError(
                "the submission answers another split",
                path=submission,
                found=found,
                required=f"{split} (--split)",
            )
        if out is not None:
            write_report(scores, out, data=data)
    if hide_truth:
        scores = public_scores(scores)
    for hint in scores.hints:
        echo(f"Warning: {hint}", err=True)
    if as_json:
        echo_json(scores.document, sort_keys=True)
    else:
        _print(scores, out)


def _notes(notes: Mapping[str, str]) -> list[str]:
    """Return one line per cause: the same text, or the same optional columns left out."""
    columns, others = [], dict[str, list[str]]()
    for name, text in notes.items():
        cause, _, effect = text.partition(": ")
        if cause.startswith("the submission has "):
            columns.append((cause.removeprefix("the submission has "), effect))
        else:
            others.setdefault(text, []).append(name)
    lines = [f"Note, {', '.join(names)}: {text}" for text, names in others.items()]
    if columns:
        without = dict.fromkeys(column for column, _ in columns)
        effects = dict.fromkeys(effect for _, effect in columns if effect)
        lines.append(f"Note: the submission has {', '.join(without)}: {'; '.join(effects)}")
    return lines


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
        echo(f"  {heading(metric, document).in_text:32} {cells}")
    for line in _notes(document["notes"]):
        echo(line, err=True)
    if out is not None:
        echo(f"Report: {out / 'report.html'}")
