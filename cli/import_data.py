"""`pliant import`: bring in images and point annotations made elsewhere."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, Literal

import click

from pliant.cli.terminal import echo


@click.command("import")
@click.argument("source", metavar="SOURCE", type=click.Path(path_type=Path))
@click.option(
    "--out", required=True, metavar="DIR", type=click.Path(path_type=Path), help="A new folder."
)
@click.option("--id", "dataset_id", metavar="NAME", help="The dataset's id; default: DIR's name.")
@click.option(
    "--kind",
    type=click.Choice(["rope", "cloth"]),
    help="What the points lie on; default: rope for knots_info.json, cloth for tracks.",
)
@click.option(
    "--split",
    type=click.Choice(["train", "val", "test"]),
    default="test",
    show_default=True,
    help="The split that all of it becomes.",
)
@click.option("--title", default="", help="One line for people.")
@click.option("--licence", default="LicenseRef-unknown", show_default=True, help="SPDX identifier.")
@click.option(
    "--queries",
    type=click.Choice(["first", "pairs"]),
    help="Ask each point where it is first seen (TAP-Vid), or in drawn pairs of frames; "
    "default: pairs for knots_info.json, first for tracks.",
)
@click.option("--pairs", default=100, show_default=True, help="Pairs drawn, with --queries pairs.")
@click.option("--size", metavar="WxH", help="Bring every frame to this size, px.")
@click.option(
    "--pixels",
    type=click.Choice(["rounded", "index"]),
    default="rounded",
    show_default=True,
    help="knots_info.json: numbers are rounded positions, or columns and rows of pixels.",
)
@click.option("--episode", is_flag=True, help="knots_info.json: the frames follow in time.")
@click.option(
    "--coordinates",
    type=click.Choice(["auto", "normalised", "pixels"]),
    default="auto",
    show_default=True,
    help="Tracks: positions are shares of the frame, or pixels from its corner.",
)
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON document.")
def command(
    source: Path,
    out: Path,
    dataset_id: str | None,
    kind: Literal["rope", "cloth"] | None,
    split: Literal["train", "val", "test"],
    title: str,
    licence: str,
    queries: Literal["first", "pairs"] | None,
    pairs: int,
    size: str | None,
    pixels: Literal["rounded", "index"],
    episode: bool,
    coordinates: Literal["auto", "normalised", "pixels"],
    as_json: bool,
) -> None:
    """Bring in SOURCE as a dataset that can be validated, answered and scored.

    SOURCE is a folder of images with the paper's knots_info.json, or a file of TAP-Vid tracks
    (pickle or npz; nothing in it is executed). Depth, cameras and material are not known and
    left out; the answers are written beside DIR, as DIR-truth/SPLIT.parquet.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    from pliant.converters.knots import read_knots
    from pliant.converters.tapvid import read_tapvid
    from pliant.converters.writer import ImportSettings, write_imported
    from pliant.spec.errors import CallError

    facts: dict[str, Any] = {"source": source.name}
    if source.is_dir():
        clips = [read_knots(source, pixels=pixels, temporal=episode)]
        facts |= {"format": "knots_info.json", "pixels": pixels}
    elif source.is_file():
        clips = read_tapvid(source, coordinates=coordinates)
        facts |= {"format": "tap-vid", "coordinates": coordinates}
    else:
        raise CallError("there is nothing to import", path=source)
    folder = source.is_dir()
    settings = ImportSettings(
        id=dataset_id or out.name,
        kind=kind or ("rope" if folder else "cloth"),
        split=split,
        title=title,
        licence=licence,
        queries=queries or ("pairs" if folder else "first"),
        pairs=pairs,
        size=None if size is None else _size(size),
    )
    columns = ("Writing", BarColumn(), MofNCompleteColumn(), "frames", TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=as_json) as bar:
        task = bar.add_task("", total=None)
        done = write_imported(
            clips,
            out,
            settings,
            facts,
            progress=lambda count, total: bar.update(task, completed=count, total=total),
        )
    if as_json:
        document = {**vars(done), "dataset": str(done.dataset), "truth": str(done.truth)}
        echo(json.dumps(document, indent=1))
        return
    echo(
        f"{done.dataset}: {done.queries:,} queries in {done.pairs:,} pairs of {done.frames:,} "
        f"frames in {done.sequences:,} sequences. Answers: {done.truth}\n"
        f"Then: pliant predict METHOD --data {done.dataset} --split {split} --out SUB.parquet; "
        f"pliant evaluate SUB.parquet --data {done.dataset} --truth {done.truth}"
    )


def _size(text: str) -> tuple[int, int]:
    from pliant.spec.errors import CallError

    match = re.fullmatch(r"(\d{1,4})x(\d{1,4})", text)
    if match is None or 0 in (int(match[1]), int(match[2])):
        raise CallError("--size is no size", found=repr(text)[:40], required="WxH, such as 256x256")
    return int(match[1]), int(match[2])
