"""`pliant submission`: a submission made of a table of answers, or one to fill in."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from pliant.cli.options import (
    FILE,
    data_option,
    json_option,
    kind_option,
    split_option,
    submission_out_option,
)
from pliant.cli.terminal import echo_result, to_call


@click.command()
@click.argument("answers", required=False, type=FILE, metavar="[ANSWERS]")
@data_option("The dataset; its queries suffice.")
@split_option
@submission_out_option
@kind_option("a sparse method's")
@click.option(
    "--method", metavar="NAME", help="Shown in reports; default: the name of the file ANSWERS."
)
@click.option(
    "--allow-missing", is_flag=True, help="Write a submission that does not answer every query."
)
@json_option
def command(
    answers: Path | None,
    data: Path,
    split: str,
    out: Path,
    kind: Literal["answers", "matches"],
    method: str | None,
    allow_missing: bool,
    as_json: bool,
) -> None:
    """Make a submission from ANSWERS: CSV, TSV, JSON lines, or Parquet of pandas or polars.

    Its columns are u and v in pixels, with the centre of the first pixel at (0.5, 0.5), and
    optionally visible and sigma. The rows answer the queries that pair_id and query_id name, or,
    without these columns, those of the queries file in its order. For matches the columns are
    pair_id, u_a, v_a, u, v and score. Other columns are left out.

    Without ANSWERS, writes a submission to fill in: keys and footer are complete, u and v are NaN
    until you set them (for matches, each pair has one row to be replaced).
    """
    from pliant.baselines.answers_file import submission_of_file
    from pliant.baselines.submission_file import write_template
    from pliant.spec.dataset import Dataset

    dataset = Dataset.open(data)
    unused: list[str] = []
    if answers is None:
        method = method or "template"
        rows = write_template(dataset, split, out, kind, name=method)
        what = "answers" if kind == "answers" else "pairs"
        fill = "u and v" if kind == "answers" else "u_a, v_a, u, v and score"
        text = f"{out}: {rows:,} {what} of {dataset.id}/{split} to fill in ({fill}). "
    else:
        method = method or answers.stem
        rows, unused = submission_of_file(
            answers, dataset, split, out, kind, name=method, allow_missing=allow_missing
        )
        text = f"{out}: {rows:,} {kind} of {dataset.id}/{split} by {method}. "
        if unused:
            text += f"Columns left out: {', '.join(name or '(unnamed)' for name in unused)}. "
    text += f"Then: {to_call('pliant', 'check', out, '--data', data)}"
    facts = {"submission": str(out), "kind": kind, "split": split, "rows": rows}
    document = {**facts, "method": {"name": method}, "columns_left_out": unused}
    echo_result(document, text, as_json=as_json)
