"""`pliant convert`: write a dataset in the format of another tool."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import click

from pliant.cli.options import PATH, json_option, out_option
from pliant.cli.terminal import echo, echo_result, progress_bar, to_call
from pliant.spec.text import plural

TARGET_NAMES: Final = ["rerun", "lerobot", "coco", "tapvid", "webdataset", "glb"]


@click.command("convert")
@click.argument("data", metavar="DATA", type=PATH)
@click.option("--to", type=click.Choice(TARGET_NAMES), required=True, help="Format to write.")
@out_option("FOLDER", "A new folder.")
@click.option(
    "--split", help="Only this split; default: every split whose truth is in the dataset."
)
@click.option("--tier", help="Only this tier.")
@click.option("--sequence", "sequences", metavar="ID", multiple=True, help="Only this sequence.")
@click.option(
    "--points",
    type=click.IntRange(min=1),
    help="Tracked points per sequence at most; default: all, for coco 64. Meshes have all.",
)
@click.option(
    "--frame-rate",
    type=float,
    default=15.0,
    show_default=True,
    metavar="HZ",
    help="Frames per second for lerobot and glb; a dataset has no times.",
)
@json_option
def command(
    data: Path,
    to: str,
    out: Path,
    points: int | None,
    frame_rate: float,
    as_json: bool,
    **which: Any,
) -> None:
    """Write the dataset DATA in the format of another tool.

    Lists first what the format cannot store.
    """
    from pliant.converters.convert import TARGETS, chosen_sequences, convert
    from pliant.converters.targets.recording import Options
    from pliant.spec.dataset import Dataset

    target = TARGETS[to]
    sequences = chosen_sequences(Dataset.open(data), **which)
    if not as_json:
        echo(f"{target.title} cannot store: {'; '.join(target.lost)}.", err=True)
    with progress_bar("Converting", "sequences", hidden=as_json) as bar:
        size = convert(sequences, target, out, Options(points, frame_rate), bar)
    document = {
        "target": target.name,
        "out": str(out),
        "sequences": len(sequences),
        "bytes": size,
        "lost": list(target.lost),
    }
    opened_by = target.opened_by.format(out=out, shell=to_call(out))
    text = f"Wrote {plural(len(sequences), 'sequence')} to {out}. Open with: {opened_by}"
    echo_result(document, text, as_json=as_json)
