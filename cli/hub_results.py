"""`pliant hub-results`: a report or a receipt as `.eval_results` of a model's repository."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.options import PATH, json_option, out_option
from pliant.cli.terminal import echo_result
from pliant.spec.errors import CallError


@click.command("hub-results")
@click.argument("scored", metavar="REPORT|RECEIPT.json", type=PATH)
@click.option("--dataset", required=True, metavar="USER/NAME", help="Id of the dataset on the Hub.")
@click.option(
    "--split", default="test", show_default=True, help="Split of a receipt; a report names its own."
)
@click.option("--url", metavar="URL", help="Page that shows where the scores come from.")
@out_option("MODEL", "Folder of the model's repository.", kind=PATH)
@json_option
def command(
    scored: Path, dataset: str, split: str, url: str | None, out: Path, as_json: bool
) -> None:
    """Write the scores of REPORT or RECEIPT.json into MODEL/.eval_results.

    The Hub shows them on the model's page and on the dataset's leaderboard. The value is the
    percentage of answers within 8 pixels, for the split and for each of its tiers.
    """
    from pliant.publishing.hub_results import results, write_results
    from pliant.spec.io.jsonfiles import read_json

    if dataset.count("/") != 1:
        raise CallError(
            "not an id of the Hub", where="--dataset", found=dataset, required="USER/NAME"
        )
    file = scored / "scores.json" if scored.is_dir() else scored
    entries = results(read_json(file), dataset, split=split, url=url)
    path = write_results(entries, out)
    echo_result({"file": str(path), "results": entries}, f"Results: {path}", as_json=as_json)
