"""`pliant leaderboard`: one sortable page from many reports, or a site with all of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pliant.cli.challenge import database_option
from pliant.cli.options import json_option, out_option, reports_argument
from pliant.cli.terminal import echo, echo_result
from pliant.spec.errors import CallError
from pliant.spec.text import plural

if TYPE_CHECKING:
    from pliant.evaluator import Scores


@click.command("leaderboard")
@reports_argument
@out_option("FILE.html|SITE", "One page, or a folder for a site; an earlier one is replaced.")
@click.option(
    "--title",
    metavar="TEXT",
    help="Site: heading of the leaderboard and the README; default: the dataset's title.",
)
@click.option(
    "--hide-truth",
    is_flag=True,
    help="Site: show only rounded headline metrics, so that they reveal no held-out answer; "
    "needs reports of `pliant evaluate --hide-truth`.",
)
@database_option
@json_option
def command(
    reports: tuple[Path, ...],
    out: Path,
    title: str | None,
    hide_truth: bool,
    database: str | None,
    as_json: bool,
) -> None:
    """Compare REPORTS: report folders, folders that contain them, or one challenge.

    FILE.html is one page with the table. SITE is a folder of plain files with the table and every
    report: look at it with `pliant serve SITE`, copy it to any web server, or upload it as a
    Hugging Face Space (its README.md has `sdk: static`). For a challenge, the site has the public
    pages of its service. Reports of different protocols, datasets or splits are refused.
    """
    document: dict[str, object]
    shown: list[Scores] = []
    of_challenge = len(reports) == 1 and (reports[0] / "challenge.yaml").is_file()
    if of_challenge and (title is not None or hide_truth or out.suffix == ".html"):
        raise CallError(
            "a challenge is written as a site with its own title, without the truth",
            fix="Name a folder, and leave --title and --hide-truth out: --out SITE",
        )
    if out.suffix == ".html":
        if title is not None or hide_truth:
            raise CallError(
                "--title and --hide-truth apply to a site only", fix="Name a folder: --out SITE"
            )
        shown = _write_page(reports, out)
        text, document = f"{plural(len(shown), 'report')}: {out}", {"page": str(out)}
    elif of_challenge:
        from pliant.cli.challenge import open_challenge
        from pliant.service.site import write_challenge_site

        pages = write_challenge_site(open_challenge(reports[0], database), out)
        text = f"{plural(len(pages), 'leaderboard')}: {out / 'index.html'}"
        document = {"site": str(out), "pages": pages}
    else:
        from pliant.evaluator.report.site import write_site

        named = write_site(reports, out, title=title, hide_truth=hide_truth)
        text = f"{plural(len(named), 'report')}: {out / 'index.html'}"
        shown, document = list(named.values()), {"site": str(out), "reports": list(named)}
    echo_result(document, text, as_json=as_json)
    if not hide_truth and any(scores.document.get("hide_truth") for scores in shown):
        echo(
            "Warning: the reports were scored with --hide-truth, so their answers are held out, "
            "and this shows figures that reveal them. To publish: --out SITE --hide-truth.",
            err=True,
        )


def _write_page(reports: tuple[Path, ...], out: Path) -> list[Scores]:
    """Write the page of the table alone; return what it shows."""
    from pliant.evaluator.report.leaderboard import read_reports, render_leaderboard
    from pliant.spec.io.writing import write_file

    scores = read_reports(reports)
    page = render_leaderboard(scores)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_file(out, page)
    return scores
