"""`pliant publish`: a public half that others host, and a private half with the answers."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pliant.cli.interrupts import terminated_like_interrupted
from pliant.cli.terminal import echo
from pliant.spec.errors import CallError

if TYPE_CHECKING:
    from pliant.publishing import Published
    from pliant.publishing.publish import Finish, Progress

_UNITS = {"": 1, "B": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9}


@click.command("publish")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--out", required=True, metavar="DIR2", type=click.Path(path_type=Path), help="Public half."
)
@click.option(
    "--hold-out",
    "hold_out",
    multiple=True,
    metavar="SPLIT",
    help="Keep this split's answers out of the public half (may be repeated).",
)
@click.option(
    "--private",
    metavar="DIR3",
    type=click.Path(path_type=Path),
    help="Private half.  [default: DIR2-private]",
)
@click.option(
    "--shard-size", default="500MB", show_default=True, help="About how large a shard is."
)
@click.option("--webdataset", is_flag=True, help="Write the frames as WebDataset tar files too.")
@click.option("--author", "authors", multiple=True, metavar="NAME", help="Who publishes it.")
@click.option("--url", metavar="URL", help="Where it will be hosted.")
@click.option("--date", metavar="YYYY-MM-DD", help="Day of the release.")
@click.option(
    "--bundle/--no-bundle",
    default=True,
    help="With --hold-out, put a Codabench bundle into the private half (the default).",
)
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON document on stdout.")
def command(
    folder: Path,
    out: Path,
    hold_out: tuple[str, ...],
    private: Path | None,
    shard_size: str,
    webdataset: bool,
    authors: tuple[str, ...],
    url: str | None,
    date: str | None,
    bundle: bool,
    as_json: bool,
) -> int:
    """Publish the dataset DIR: packed, described, with checksums, and answers held out.

    DIR2 becomes the public half: upload it as it is. With --hold-out the truth of those splits,
    and all it could be read from, goes into a folder of its own, DIR2-private: keep it. The same
    dataset gives the same bytes wherever it is published.
    """
    from pliant.publishing import PublishSettings, publish

    settings = PublishSettings(
        hold_out=tuple(dict.fromkeys(name for text in hold_out for name in text.split(","))),
        shard_bytes=parse_size(shard_size),
        webdataset=webdataset,
        authors=authors,
        url=url,
        date=date,
    )
    finish = _bundle_writer() if bundle and settings.hold_out else None
    with terminated_like_interrupted(""), _bar(as_json) as show:
        published = publish(folder, out, settings, private=private, progress=show, finish=finish)
    if as_json:
        echo(json.dumps(published.as_dict(), indent=1))
    else:
        _print(published, out, private or Path(f"{out}-private"))
    for text in published.warnings:
        echo(f"Warning: {text}.", err=True)
    return 0


def parse_size(text: str) -> int:
    """Return a size in bytes, of a text such as `500MB`.

    Raises:
        CallError: It is no size.
    """
    match = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]+)?)\s*([KMG]?B?)\s*", text.upper())
    unit = None if match is None else match[2]
    if match is None or unit is None or (unit and not unit.endswith("B")):
        raise CallError(
            "the size cannot be read", where="--shard-size", found=text, required="such as 500MB"
        )
    return int(float(match[1]) * _UNITS[unit])


def _bundle_writer() -> Finish:
    """Return what adds the Codabench bundle to the private half."""
    from pliant.publishing.competition.bundle import write_bundle

    def finish(public: Path, private: Path | None) -> None:
        if private is not None:
            write_bundle(public, private, private / "codabench")

    return finish


@contextmanager
def _bar(hidden: bool) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        "sequences",
        TimeRemainingColumn(),
    )
    with Bar(*columns, console=Console(stderr=True), transient=True, disable=hidden) as bar:
        task = bar.add_task("", total=None)
        yield lambda what, done, total: bar.update(
            task, description=what, completed=done, total=total
        )


def _print(published: Published, public: Path, private: Path) -> None:
    """Print the result, its folders under the names they were asked for by."""
    echo(
        f"{public}: {published.sequences:,} sequences, {published.frames:,} frames, "
        f"{published.shards} shards, {published.bytes / 1e6:,.1f} MB; "
        f"SHA256SUMS {published.checksums_sha256[:16]}…"
    )
    if published.private is not None:
        echo(f"{private}: the answers. Keep this folder to yourself.")
