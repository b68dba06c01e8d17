"""A leaderboard and its reports as a static site: files that any web server or Hub Space hosts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import yaml

from pliant.evaluator.report.leaderboard import find_reports, render_leaderboard
from pliant.evaluator.report.pages import render_page
from pliant.evaluator.report.report import check_out_dir, render_report
from pliant.evaluator.scores import REPORT_HTML, SCORES_JSON, Scores, public_scores, read_scores
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.staging import staged

INDEX: Final = "index.html"
README: Final = "README.md"
REPORTS: Final = "reports"
_KNOWN: Final = (INDEX, README, REPORTS)


def write_site(
    places: Sequence[Path], out: Path, *, title: str | None, hide_truth: bool
) -> dict[str, Scores]:
    """Write a site: `index.html` with the leaderboard, `reports/NAME/` with each report.

    All links are relative, so it works below any URL and from a local disk.

    Args:
        places: Report folders, or folders of report folders.
        out: The site's folder: new, empty, or an earlier site, which is replaced.
        title: The site's name; None takes the dataset's title.
        hide_truth: Show only the `public_scores`: no pictures of example pairs, no
            tables of pairs, rounded headline metrics.

    Returns:
        The names of the reports' folders, each with its scores.

    Raises:
        CallError: The reports do not compare, `out` contains something else, or `hide_truth` is
            asked for reports that were scored without it.
        SubmissionError: A report is damaged.
    """
    check_out_dir(out, _KNOWN, "site")
    folders = find_reports(places)
    reports = [read_scores(folder) for folder in folders]
    names = _names(folders)
    links = [f"{REPORTS}/{name}/{REPORT_HTML}" for name in names]
    page = render_leaderboard(reports, links, title=title, hide_truth=hide_truth)
    with staged(out) as site:
        (site / INDEX).write_text(page, encoding="utf-8")
        (site / README).write_text(_readme(reports, links, title), encoding="utf-8")
        for folder, scores, name in zip(folders, reports, names, strict=True):
            (site / REPORTS / name).mkdir(parents=True)
            _copy_report(folder, scores, site / REPORTS / name, hide_truth=hide_truth)
    return dict(zip(names, reports, strict=True))


def _copy_report(folder: Path, scores: Scores, target: Path, *, hide_truth: bool) -> None:
    page = folder / REPORT_HTML
    if hide_truth:
        scores = public_scores(scores)
    if hide_truth or not page.is_file():
        text = render_report(scores)  # scores that were read back have no examples
    else:
        text = page.read_text(encoding="utf-8")
    back = f'<body>\n<nav><a href="../../{INDEX}">← All methods</a></nav>'
    text = text.replace("<body>", back, 1)
    if hide_truth:
        (target / REPORT_HTML).write_text(text, encoding="utf-8")
        write_json(target / SCORES_JSON, scores.document)
    else:
        scores.write(target, text)


def _names(folders: Sequence[Path]) -> list[str]:
    """Return a name for each report's folder in the site, fit for a URL."""
    names: list[str] = []
    for folder in folders:
        wanted = re.sub(r"[^A-Za-z0-9_-]+", "-", folder.resolve().name).strip("-") or "report"
        name, number = wanted, 1
        while name.lower() in {taken.lower() for taken in names}:
            number += 1
            name = f"{wanted}-{number}"
        names.append(name)
    return names


def _readme(reports: Sequence[Scores], links: Sequence[str], title: str | None) -> str:
    """Return README.md, whose front matter makes the folder a static Hugging Face Space."""
    document = reports[0].document
    shown = title or f"{document['dataset']['title']}: leaderboard"
    front = {
        "title": shown,
        "emoji": "🪢",
        "colorFrom": "blue",
        "colorTo": "green",
        "sdk": "static",
        "app_file": INDEX,
        "pinned": False,
    }
    return render_page(
        "site.md.j2",
        front_matter=yaml.safe_dump(front, sort_keys=False, allow_unicode=True, width=1000),
        title=shown,
        d=document,
        names=list(zip((scores.method for scores in reports), links, strict=True)),
    )
