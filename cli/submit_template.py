"""`pliant submit-template`: a submission that lacks nothing but its answers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import click

from pliant.cli.terminal import echo


@click.command("submit-template")
@click.option(
    "--data",
    required=True,
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="The dataset; its queries suffice.",
)
@click.option("--split", default="test", show_default=True, help="Whose queries to answer.")
@click.option(
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    metavar="SUB.parquet",
    help="The file to write; an earlier submission there is replaced.",
)
@click.option(
    "--kind",
    type=click.Choice(["answers", "matches"]),
    default="answers",
    show_default=True,
    help="Answers to the queries, or a sparse method's own keypoint matches.",
)
@click.option(
    "--method", default="template", show_default=True, metavar="NAME", help="Shown in reports."
)
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON document.")
def command(
    data: Path,
    split: str,
    out: Path,
    kind: Literal["answers", "matches"],
    method: str,
    as_json: bool,
) -> None:
    """Write a submission to be filled in.

    Keys and footer are right; u and v are NaN until you set them (for matches, each pair has
    one row to be replaced). pliant check names every row that is still empty.
    """
    from pliant.baselines.submission_file import write_template
    from pliant.spec.dataset import Dataset

    dataset = Dataset.open(data)
    rows = write_template(dataset, split, out, kind, name=method)
    if as_json:
        facts = {"submission": str(out), "kind": kind, "split": split, "rows": rows}
        echo(json.dumps({**facts, "method": {"name": method}}))
        return
    what = "answers" if kind == "answers" else "pairs"
    fill = "u and v" if kind == "answers" else "u_a, v_a, u, v and score"
    echo(
        f"{out}: {rows:,} {what} of {dataset.id}/{split} to fill in ({fill}). "
        f"Then: pliant check {out} --data {data}"
    )
