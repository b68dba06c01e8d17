"""`pliant explore`: move over a picture; see truth, answers and heat maps on a local web page."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.options import PATH, port_options
from pliant.cli.terminal import show_page
from pliant.spec.text import plural


@click.command()
@click.argument("data", metavar="DATA", type=PATH)
@click.argument("answers", metavar="[REPORT|SUB.parquet|METHOD]…", nargs=-1)
@click.option(
    "--truth",
    metavar="TRUTH",
    type=PATH,
    help="The split's truth, its folder, or the private half of `pliant publish`.",
)
@port_options
def command(
    data: Path, answers: tuple[str, ...], truth: Path | None, port: int, no_browser: bool
) -> None:
    """Explore DATA: point at one picture and see where the point is in the other.

    Each METHOD (a name that `pliant methods` lists, the folder of a training run or FILE.py:CLASS)
    answers while the pointer moves. A submission, or a REPORT of `pliant evaluate` with its
    submission in the same folder, the one above or the current one, shows its recorded answers.
    Default: the shipped models for the objects of DATA, and SIFT, where torch and OpenCV are
    installed. The page is served to this machine alone; Ctrl-C ends.
    """
    from pliant.api import load, open_method
    from pliant.viewer.explorer.app import open_explorer
    from pliant.viewer.local_app import LocalServer

    dataset = load(data)
    if truth is not None:
        dataset = dataset.with_truth(truth)
    explorer = open_explorer(dataset, answers, open_method)
    names = ", ".join(method.name for method in explorer.methods) or "no methods"
    subject = f"{dataset.id}: {plural(len(dataset.sequences), 'sequence')}, {names}"
    show_page(LocalServer(explorer.application, port), subject, no_browser=no_browser)
