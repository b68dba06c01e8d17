"""`pliant import`: import images and point annotations of other tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pliant.cli.options import PATH, choice_option, image_size, json_option, out_option, path_option
from pliant.cli.terminal import echo_result, progress_bar, to_call
from pliant.spec.text import plural

if TYPE_CHECKING:
    from pliant.converters.writer import Imported


@click.command("import")
@click.argument("source", metavar="SOURCE", type=PATH)
@out_option("DIR", "A new folder.")
@click.option("--id", metavar="NAME", help="The dataset's id; default: DIR's name.")
@click.option(
    "--kind",
    metavar="NAME",
    help="Kind of the object: rope, cloth, or another name; default: rope for pictures, cloth "
    "for tracks.",
)
@choice_option("--split", ["train", "val", "test"], "Split of the imported data.", "test")
@click.option("--title", default="", help="Title of the dataset, one line.")
@click.option("--licence", default="LicenseRef-unknown", show_default=True, help="SPDX identifier.")
@click.option(
    "--version",
    default="1.0.0",
    show_default=True,
    metavar="X.Y.Z",
    help="Version of the dataset; corrected annotations need a new one.",
)
@choice_option(
    "--queries",
    ["first", "strided", "pairs"],
    "Query each point in its first visible frame (first) or in every fifth frame (strided), as in "
    "TAP-Vid, or in random pairs of frames (pairs); "
    "default: pairs for pictures, first for tracks.",
)
@click.option("--pairs", default=100, show_default=True, help="Number of pairs (--queries pairs).")
@path_option("--pair-list", "FILE.csv", "Pictures: query only these pairs; columns source,target.")
@click.option(
    "--size",
    metavar="WxH",
    help="Resize every frame to this size, px. Pictures keep their proportions on black; tracks "
    "are stretched. Default: the smallest size that all pictures fit in.",
)
@path_option(
    "--masks",
    "FOLDER",
    "Pictures: a mask for each, of the same name and size, black outside the object; a rope's ball "
    "is separated from it. Default: image_masks/ of a knots_info.json.",
)
@path_option(
    "--depth",
    "FOLDER",
    "Pictures: a depth image for each, of the same name and size: 16-bit millimetres (png, tif) "
    "or metres (npy); 0 is unknown.",
)
@choice_option(
    "--pixels",
    ["rounded", "index"],
    "Pictures: coordinates are positions measured from the image corner (rounded), or columns and "
    "rows of pixels, to which 0.5 is added (index).",
    "rounded",
)
@click.option("--episode", is_flag=True, help="Pictures: frames are consecutive in time.")
@click.option(
    "--alike",
    metavar="A,B[,C,D]",
    multiple=True,
    help="Pictures: points that look alike: two names to exchange, or four corners in their order. "
    "Repeat it for groups that are exchanged together. They are alternatives in the scores.",
)
@json_option
def command(source: Path, out: Path, as_json: bool, **given: Any) -> None:
    """Import SOURCE as a dataset that can be validated, answered and scored.

    SOURCE is annotations.csv (picture,point,x,y,visible), COCO keypoints, LabelMe files or the
    paper's knots_info.json, as a file or its folder, with its pictures; or an npz file of TAP-Vid
    tracks, or a folder of them. Cameras and material coordinates are not known and omitted; the
    answers are written to DIR-truth/SPLIT.parquet.
    """
    from pliant.converters import ImportSettings, PictureOptions, read_source, write_imported

    given["size"] = given["size"] and image_size(given["size"])
    options = PictureOptions(
        pixels=given.pop("pixels"),
        temporal=given.pop("episode"),
        pairs=given.pop("pair_list"),
        size=given["size"],
        masks=given.pop("masks"),
        depth=given.pop("depth"),
    )
    with progress_bar("Reading", "files", hidden=as_json) as bar:
        found = read_source(source, options, bar)
    defaults = {"id": out.resolve().name, "kind": found.kind, "queries": found.queries}
    settings = ImportSettings(**defaults | {k: v for k, v in given.items() if v not in (None, "")})
    with progress_bar("Writing", "frames", hidden=as_json) as bar:
        done = write_imported(found.clips, out, settings, found.facts, progress=bar)
    notes = list(found.notes)
    if done.balls:
        frames = f"{done.balls:,} of {done.frames:,} frames"
        notes.append(f"A ball at the rope's end was separated from the masks of {frames}.")
    if done.off_mask > done.on_mask:
        notes.append(
            f"{done.off_mask:,} of {done.off_mask + done.on_mask:,} visible points are not on the "
            "masks: check that these are black outside the object, and not on it."
        )
    document = {**vars(done), "dataset": str(done.dataset), "truth": str(done.truth)}
    text = "\n".join([*notes, _summary(done, settings.split)])
    echo_result({**document, "notes": notes}, text, as_json=as_json)


def _summary(done: Imported, split: str) -> str:
    """Return what was written, and what to call next."""
    data = ("--data", done.dataset)
    predict = to_call(
        "pliant", "predict", "METHOD", *data, "--split", split, "--out", "SUB.parquet"
    )
    evaluate = to_call("pliant", "evaluate", "SUB.parquet", *data, "--truth", done.truth)
    return (
        f"{done.dataset}: {plural(done.queries, 'query')} in "
        f"{plural(done.pairs, 'pair')} of {plural(done.frames, 'frame')} in "
        f"{plural(done.sequences, 'sequence')}. Answers: {done.truth}\n"
        f"Then: {predict}; {evaluate}"
    )
