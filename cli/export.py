"""`pliant export`: a trained model with its model card."""

from __future__ import annotations

import json
from pathlib import Path

import click

from pliant.cli.terminal import echo
from pliant.spec.errors import MissingExtraError

_DIR = click.Path(path_type=Path)


@click.command()
@click.argument("run", type=_DIR)
@click.option("--name", required=True, help="What the model is called, such as don-rope.")
@click.option("--data", required=True, type=_DIR, metavar="DIR", help="What it was trained on.")
@click.option("--out", required=True, type=_DIR, metavar="FOLDER", help="OUT/NAME is written.")
@click.option(
    "--scores",
    multiple=True,
    type=_DIR,
    metavar="REPORT",
    help="A report of `pliant evaluate` for the card; may be given several times.",
)
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON document.")
def command(
    run: Path, name: str, data: Path, out: Path, scores: tuple[Path, ...], as_json: bool
) -> None:
    """Write a finished training run as a model to be passed on: small weights and a card.

    The folder is a run that answers: `pliant predict OUT/NAME`. In `models/shipped/` of the
    package it is called by its name alone.
    """
    try:
        from pliant.models.export import export_run
    except ImportError as error:
        raise MissingExtraError("exporting a model", "train") from error
    from pliant.evaluator.scores import SCORES_JSON, read_scores
    from pliant.spec.dataset import Dataset

    reports = [read_scores(path.parent if path.name == SCORES_JSON else path) for path in scores]
    folder = export_run(run, name, out, Dataset.open(data), reports)
    size = sum(path.stat().st_size for path in folder.iterdir())
    if as_json:
        echo(json.dumps({"model": str(folder), "name": name, "bytes": size}))
        return
    echo(f"{folder}: {size / 1e6:.1f} MB; read {folder / 'CARD.md'}")
