"""`pliant view`: figures of a dataset."""

from __future__ import annotations

import json
from pathlib import Path

import click

from pliant.cli.terminal import echo
from pliant.spec.errors import CallError

_FIGURES = ("sheet", "index", "depth", "anatomy", "tracks")


@click.command("view")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--out",
    required=True,
    metavar="FILE",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Image to write: .png, .jpg, .webp; anatomy and tracks also .pdf, .svg; with --tracks "
    "also .gif and .mp4.",
)
@click.option(
    "--figure",
    type=click.Choice(_FIGURES),
    default="sheet",
    show_default=True,
    help="sheet: frames over index colours and depth; index, depth: one layer; "
    "anatomy: curve, mesh, image, depth, index colours of a frame; tracks: a strip with points.",
)
@click.option("--sequence", metavar="ID", help="A sequence; all, or the first that fits.")
@click.option("--frame", type=int, default=0, show_default=True, help="Frame of anatomy.")
@click.option(
    "--count", type=int, default=24, show_default=True, help="Images on a sheet; steps of tracks."
)
@click.option(
    "--tracks",
    metavar="SUB.parquet",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Draw a submission's tracks through an episode: dots are its answers, lines lead to the "
    "truth, hollow dots are points that cannot be seen.",
)
@click.option(
    "--frames",
    metavar="F,F,...",
    help="Frames of --tracks; default: 0, 22 and 87 where the episode has them.",
)
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON document on stdout.")
def command(
    folder: Path,
    out: Path,
    figure: str,
    sequence: str | None,
    frame: int,
    count: int,
    tracks: Path | None,
    frames: str | None,
    as_json: bool,
) -> None:
    """Draw a figure of the dataset DIR: contact sheets, index colours, depth, tracks."""
    from pliant.viewer.figures import draw_figure, draw_predicted_tracks

    if frames is not None and tracks is None:
        raise CallError("--frames belongs to --tracks", found=frames)
    if tracks is not None:
        figure = "tracks"
        draw_predicted_tracks(folder, tracks, out, sequence=sequence, frames=_numbers(frames))
    else:
        draw_figure(folder, out, figure=figure, sequence=sequence, frame=frame, count=count)
    if as_json:
        echo(json.dumps({"out": str(out), "figure": figure, "bytes": out.stat().st_size}))
    else:
        echo(f"Wrote {out}")


def _numbers(text: str | None) -> list[int] | None:
    """Return frame numbers from a list like 0,22,87."""
    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError as error:
        raise CallError("frames are whole numbers", where="--frames", found=text) from error
