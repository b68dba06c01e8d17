"""`pliant leaderboard`: one sortable page from many reports."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.terminal import echo


@click.command("leaderboard")
@click.argument(
    "reports", metavar="REPORTS…", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "--out",
    required=True,
    metavar="FILE.html",
    type=click.Path(path_type=Path, dir_okay=False),
    help="The page; replaced if it is there.",
)
def command(reports: tuple[Path, ...], out: Path) -> int:
    """Write one page from REPORTS: report folders, or folders that hold them.

    Reports of different protocols, datasets or splits are refused.
    """
    from pliant.evaluator.report.leaderboard import read_reports, render_leaderboard
    from pliant.spec.io.writing import replacing

    scores = read_reports(reports)
    page = render_leaderboard(scores)
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as partial:
        partial.write_text(page, encoding="utf-8")
    echo(f"{len(scores)} reports: {out}")
    return 0
