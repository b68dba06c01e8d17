"""`pliant view`: figures of a dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pliant.cli.options import FILE, PATH, choice_option, json_option, out_option, path_option
from pliant.cli.terminal import echo_result
from pliant.spec.errors import CallError


@click.command("view")
@click.argument("folder", metavar="DIR", type=PATH)
@out_option(
    "FILE",
    "Image to write: .png, .jpg, .webp; tracks and points also .pdf, .svg.",
    FILE,
)
@choice_option(
    "--figure",
    ["sheet", "index", "depth", "tracks", "points"],
    "sheet: frames over index colours and depth; index, depth: one layer; "
    "tracks: a strip with points; "
    "points: the queried points, with their names where they were imported.",
    "sheet",
)
@click.option(
    "--sequence", metavar="ID", help="A sequence; default: all, or the first suitable one."
)
@click.option(
    "--count", type=int, default=24, show_default=True, help="Images on a sheet; steps of tracks."
)
@path_option(
    "--tracks",
    "SUB.parquet",
    "Draw a submission's tracks through an episode: dots are its answers, lines lead to the "
    "truth, hollow dots are points that cannot be seen.",
    kind=FILE,
)
@click.option(
    "--frames",
    metavar="F,F,...",
    help="Frames of --tracks; default: 0, 22 and 87 where the episode has them.",
)
@path_option(
    "--truth",
    "FILE",
    "Truth for --figure points; default: the dataset's, or DIR-truth/SPLIT.parquet.",
)
@json_option
def command(
    folder: Path, out: Path, tracks: Path | None, frames: str | None, as_json: bool, **what: Any
) -> None:
    """Draw a figure of the dataset DIR: contact sheets, index colours, depth, tracks."""
    from pliant.viewer.figures import draw_figure, draw_predicted_tracks

    if frames is not None and tracks is None:
        raise CallError("--frames belongs to --tracks", found=frames)
    if tracks is not None:
        what["figure"] = "tracks"
        draw_predicted_tracks(
            folder, tracks, out, sequence=what["sequence"], frames=_numbers(frames)
        )
    else:
        draw_figure(folder, out, **what)
    document = {"out": str(out), "figure": what["figure"], "bytes": out.stat().st_size}
    echo_result(document, f"Wrote {out}", as_json=as_json)


def _numbers(text: str | None) -> list[int] | None:
    """Return frame numbers from a list like 0,22,87."""
    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError as error:
        raise CallError("frames are whole numbers", where="--frames", found=text) from error
