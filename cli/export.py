"""`pliant train export`: a trained model with its model card."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.options import PATH, data_option, json_option, out_option, path_option
from pliant.cli.terminal import echo_result


@click.command("export")
@click.argument("run", type=PATH)
@click.option("--name", required=True, help="Name of the model, such as don-rope.")
@data_option("Dataset that it was trained on.")
@out_option("FOLDER", "Output folder; writes OUT/NAME.")
@path_option(
    "--scores",
    "REPORT",
    "A report of `pliant evaluate` for the card; may be given several times.",
    multiple=True,
)
@json_option
def command(
    run: Path, name: str, data: Path, out: Path, scores: tuple[Path, ...], as_json: bool
) -> None:
    """Export a finished training run as a model: small weights and a model card.

    The folder can be used like the run: `pliant predict OUT/NAME`. A model in `models/shipped/`
    of the package is used by its name.
    """
    from pliant.evaluator.scores import SCORES_JSON, read_scores
    from pliant.models.export import export_run
    from pliant.spec.dataset import Dataset

    reports = [read_scores(path.parent if path.name == SCORES_JSON else path) for path in scores]
    folder = export_run(run, name, out, Dataset.open(data), reports)
    size = sum(path.stat().st_size for path in folder.iterdir())
    text = f"{folder}: {size / 1e6:.1f} MB; read {folder / 'CARD.md'}"
    echo_result({"model": str(folder), "name": name, "bytes": size}, text, as_json=as_json)
