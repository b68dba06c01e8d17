"""`pliant site`: the leaderboard and its reports as a static site."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.challenge import database_option
from pliant.cli.options import json_option, out_option, reports_argument
from pliant.cli.terminal import echo_result


@click.command("site")
@reports_argument
@out_option("SITE", "The site's folder: new, or an earlier site, which is replaced.")
@click.option(
    "--title",
    metavar="TEXT",
    help="Heading of the leaderboard and the README; default: the dataset's title.",
)
@click.option(
    "--hide-truth",
    is_flag=True,
    help="Show only rounded headline metrics, so that no answer of a held-out split can be read "
    "off; needs reports of pliant evaluate --hide-truth.",
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
) -> int:
    """Write a site from REPORTS: report folders, folders that contain them, or one challenge.

    Of a challenge, the site has what its service shows to everybody.

    SITE is plain files: look at it with `pliant serve SITE`, copy it to any web server, or upload
    it as a Hugging Face Space (its README.md says `sdk: static`).
    """
    if len(reports) == 1 and (reports[0] / "challenge.yaml").is_file():
        from pliant.cli.challenge import open_challenge
        from pliant.service.site import write_challenge_site

        pages = write_challenge_site(open_challenge(reports[0], database), out)
        text = f"{len(pages)} leaderboards: {out / 'index.html'}"
        echo_result({"site": str(out), "pages": pages}, text, as_json=as_json)
        return 0
    from pliant.evaluator.report.site import write_site

    names = write_site(reports, out, title=title, hide_truth=hide_truth)
    text = f"{len(names)} reports: {out / 'index.html'}"
    echo_result({"site": str(out), "reports": names}, text, as_json=as_json)
    return 0
