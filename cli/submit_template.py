"""`pliant submit-template`: a submission that lacks nothing but its answers."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from pliant.cli.options import data_option, json_option, kind_option, out_option, split_option
from pliant.cli.terminal import echo_result


@click.command("submit-template")
@data_option("The dataset; its queries suffice.")
@split_option
@out_option("SUB.parquet", "The file to write; an earlier submission there is replaced.")
@kind_option("a sparse method's")
@click.option(
    "--method", default="template", show_default=True, metavar="NAME", help="Shown in reports."
)
@json_option
def command(
    data: Path,
    split: str,
    out: Path,
    kind: Literal["answers", "matches"],
    method: str,
    as_json: bool,
) -> None:
    """Write a submission to be filled in.

    Keys and footer are complete; u and v are NaN until you set them (for matches, each pair has
    one row to be replaced). pliant check names every row that is still empty.
    """
    from pliant.baselines.submission_file import write_template
    from pliant.spec.dataset import Dataset

    dataset = Dataset.open(data)
    rows = write_template(dataset, split, out, kind, name=method)
    what = "answers" if kind == "answers" else "pairs"
    fill = "u and v" if kind == "answers" else "u_a, v_a, u, v and score"
    text = (
        f"{out}: {rows:,} {what} of {dataset.id}/{split} to fill in ({fill}). "
        f"Then: pliant check {out} --data {data}"
    )
    facts = {"submission": str(out), "kind": kind, "split": split, "rows": rows}
    echo_result({**facts, "method": {"name": method}}, text, as_json=as_json)
