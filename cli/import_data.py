"""`pliant import`: bring in images and point annotations made elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import click

from pliant.cli.options import PATH, choice_option, image_size, json_option, out_option
from pliant.cli.terminal import echo_result, progress_bar


@click.command("import")
@click.argument("source", metavar="SOURCE", type=PATH)
@out_option("DIR", "A new folder.")
@click.option("--id", metavar="NAME", help="The dataset's id; default: DIR's name.")
@choice_option(
    "--kind",
    ["rope", "cloth"],
    "What the points lie on; default: rope for knots_info.json, cloth for tracks.",
)
@choice_option("--split", ["train", "val", "test"], "The split that all of it becomes.", "test")
@click.option("--title", default="", help="Title of the dataset, one line.")
@click.option("--licence", default="LicenseRef-unknown", show_default=True, help="SPDX identifier.")
@choice_option(
    "--queries",
    ["first", "pairs"],
    "Ask each point where it is first seen (TAP-Vid), or in drawn pairs of frames; "
    "default: pairs for knots_info.json, first for tracks.",
)
@click.option("--pairs", default=100, show_default=True, help="Pairs drawn, with --queries pairs.")
@click.option("--size", metavar="WxH", help="Bring every frame to this size, px.")
@choice_option(
    "--pixels",
    ["rounded", "index"],
    "knots_info.json: numbers are rounded positions, or columns and rows of pixels.",
    "rounded",
)
@click.option("--episode", is_flag=True, help="knots_info.json: the frames follow in time.")
@choice_option(
    "--coordinates",
    ["auto", "normalised", "pixels"],
    "Tracks: positions are shares of the frame, or pixels from its corner.",
    "auto",
)
@json_option
def command(
    source: Path,
    out: Path,
    pixels: Literal["rounded", "index"],
    episode: bool,
    coordinates: Literal["auto", "normalised", "pixels"],
    as_json: bool,
    **given: Any,
) -> None:
    """Bring in SOURCE as a dataset that can be validated, answered and scored.

    SOURCE is a folder of images with the paper's knots_info.json, or a file of TAP-Vid tracks
    (pickle or npz; nothing in it is executed). Depth, cameras and material are not known and
    left out; the answers are written next to DIR, as DIR-truth/SPLIT.parquet.
    """
    from pliant.converters import ImportSettings, read_source, write_imported

    found = read_source(source, pixels=pixels, temporal=episode, coordinates=coordinates)
    given["size"] = given["size"] and image_size(given["size"])
    defaults = {"id": out.name, "kind": found.kind, "queries": found.queries}
    settings = ImportSettings(**{k: v or defaults.get(k, v) for k, v in given.items()})
    with progress_bar("Writing", "frames", hidden=as_json) as bar:
        done = write_imported(found.clips, out, settings, found.facts, progress=bar)
    document = {**vars(done), "dataset": str(done.dataset), "truth": str(done.truth)}
    text = (
        f"{done.dataset}: {done.queries:,} queries in {done.pairs:,} pairs of {done.frames:,} "
        f"frames in {done.sequences:,} sequences. Answers: {done.truth}\n"
        f"Then: pliant predict METHOD --data {done.dataset} --split {settings.split} --out "
        f"SUB.parquet; pliant evaluate SUB.parquet --data {done.dataset} --truth {done.truth}"
    )
    echo_result(document, text, as_json=as_json)
