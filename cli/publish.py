"""`pliant publish`: a public half for release, and a private half with the answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pliant.cli.options import PATH, json_option, out_option, path_option
from pliant.cli.terminal import echo, echo_json, progress_bar, terminated_like_interrupted
from pliant.spec.errors import CallError
from pliant.spec.text import plural


@click.command("publish")
@click.argument("folder", metavar="DIR", type=PATH)
@out_option("DIR2", "Public half.")
@click.option(
    "--hold-out",
    multiple=True,
    metavar="SPLIT",
    help="Keep this split's answers out of the public half (may be repeated).",
)
@path_option("--private", "DIR3", "Private half.  [default: DIR2-private]")
@path_option(
    "--truth", "DIR4", "Answers of imported pictures, from `pliant import`.  [default: DIR-truth]"
)
@click.option("--shard-size", default="500MB", show_default=True, help="Approximate shard size.")
@click.option(
    "--answers-are-public",
    is_flag=True,
    help="Publish although the seed is not secret, so that anybody can regenerate the withheld "
    "answers.",
)
@click.option(
    "--author", "authors", multiple=True, metavar="NAME", help="Author, for the citation."
)
@click.option("--url", metavar="URL", help="Address of the published dataset.")
@click.option("--date", metavar="YYYY-MM-DD", help="Date of the release.")
@json_option
def command(
    folder: Path,
    out: Path,
    private: Path | None,
    truth: Path | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Package the dataset DIR for release: shards, description, checksums.

    DIR2 is the public half, ready to upload. With --hold-out, the truth of those splits and
    everything that reveals it go into a separate folder, DIR2-private, which is not published. The
    output is deterministic.
    """
    from pliant.publishing import PublishSettings, publish

    splits = dict.fromkeys(name for text in given.pop("hold_out") for name in text.split(","))
    shard_bytes = parse_size(given.pop("shard_size"))
    settings = PublishSettings(hold_out=tuple(splits), shard_bytes=shard_bytes, **given)
    with terminated_like_interrupted(""), progress_bar("", "sequences", hidden=as_json) as bar:
        published = publish(
            folder,
            out,
            settings,
            private=private,
            truth=truth,
            progress=lambda what, done, total: bar(done, total, title=what),
        )
    if as_json:
        echo_json(published.as_dict())
    else:
        echo(
            f"{out}: {plural(published.sequences, 'sequence')}, "
            f"{plural(published.frames, 'frame')}, {plural(published.shards, 'shard')}, "
            f"{published.bytes / 1e6:,.1f} MB; SHA256SUMS {published.checksums_sha256[:16]}…"
        )
        if published.private is not None:
            place = private or f"{out}-private"
            echo(f"{place}: the answers. Do not publish this folder.")
    for text in published.warnings:
        echo(f"Warning: {text}.", err=True)


def parse_size(text: str) -> int:
    """Return a size in bytes, of a text such as `500MB`.

    Raises:
        CallError: The text says no size.
    """
    from pydantic import ByteSize, TypeAdapter, ValidationError

    try:
        return TypeAdapter(ByteSize).validate_python(text)
    except ValidationError as error:
        raise CallError(
            "the size cannot be read", where="--shard-size", found=text, required="such as 500MB"
        ) from error
