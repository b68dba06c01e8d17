"""`pliant leaderboard`: one sortable page from many reports."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.options import FILE, out_option, reports_argument
from pliant.cli.terminal import echo


@click.command("leaderboard")
@reports_argument
@out_option("FILE.html", "The page; an earlier file is replaced.", FILE)
def command(reports: tuple[Path, ...], out: Path) -> int:
    """Write one page from REPORTS: report folders, or folders that contain them.

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
