"""`pliant view`: figures of a dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pliant.cli.options import FILE, PATH, choice_option, json_option, out_option
from pliant.cli.terminal import echo_result


@click.command("view")
@click.argument("folder", metavar="DIR", type=PATH)
@out_option("FILE", "Image to write: .png, .jpg, .webp; tracks also .pdf, .svg.", FILE)
@choice_option(
    "--figure",
    ["sheet", "index", "depth", "tracks"],
    "sheet: frames over index colours and depth; index, depth: one layer; "
    "tracks: a strip with points.",
    "sheet",
)
@click.option(
    "--sequence", metavar="ID", help="A sequence; default: all, or the first suitable one."
)
@click.option(
    "--count", type=int, default=24, show_default=True, help="Images on a sheet; steps of tracks."
)
@json_option
def command(folder: Path, out: Path, as_json: bool, **what: Any) -> None:
    """Draw a figure of the dataset DIR: contact sheets, index colours, depth, tracks."""
    from pliant.viewer.figures import draw_figure

    draw_figure(folder, out, **what)
    document = {"out": str(out), "figure": what["figure"], "bytes": out.stat().st_size}
    echo_result(document, f"Wrote {out}", as_json=as_json)
