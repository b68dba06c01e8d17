"""What each part of a rope model's answers brings, on pairs of one split.

`python benchmarks/rope_parts.py DATA --model don-rope --split val`. One model answers the same
queries by its network alone, with the traces of both masks, and with over and under at crossings.
"""

from __future__ import annotations

import time
from pathlib import Path

import click

from pliant.loaders.frame_store import FrameStore
from pliant.models.don.loading import load_matcher
from pliant.models.don.validation import draw_validation_pairs, validate
from pliant.models.shipped import FOLDER
from pliant.spec.dataset import Dataset


@click.command(help=__doc__)
@click.argument("data", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--model", default="don-rope", show_default=True, help="A shipped model.")
@click.option("--split", default="val", show_default=True)
@click.option("--pairs", default=60, show_default=True)
def main(data: Path, model: str, split: str, pairs: int) -> None:
    """Print a row of a table for each variant."""
    dataset = Dataset.open(data)
    store = FrameStore(dataset, "rope", split, dataset.size)
    drawn = draw_validation_pairs(store, pairs, 48, 0)
    click.echo("| answers | pooled | mean over pairs | median | PCK 8 px | CPU s per pair |")
    click.echo("|---|---|---|---|---|---|")
    for label, crossings in (("with traces", False), ("with traces, over and under", True)):
        matcher = load_matcher(FOLDER / model)
        matcher.calibration = None
        if not crossings:
            matcher.reader.crossings = None
        began = time.process_time()
        found = validate(matcher, drawn, dataset.size)
        cost = (time.process_time() - began) / len(drawn)
        if not crossings:
            _row("network alone", "network_", found)
        _row(label, "", found, f"{cost:.2f}")


def _row(label: str, prefix: str, found: dict[str, float], cost: str = "") -> None:
    rmse, mean, median, pck = (
        found[prefix + name]
        for name in ("rmse_px", "rmse_px_mean_over_pairs", "median_px", "pck_8px")
    )
    click.echo(f"| {label} | {rmse:.1f} | {mean:.1f} | {median:.1f} | {pck:.3f} | {cost} |")


if __name__ == "__main__":
    main()
