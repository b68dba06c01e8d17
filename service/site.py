"""The leaderboards of a challenge as a static site, readable without the service."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

from sqlalchemy import select

from pliant.evaluator.report.report import check_out_dir
from pliant.evaluator.report.site import INDEX
from pliant.service.audit import log_time
from pliant.service.challenge import Challenge
from pliant.service.leaderboard import Board, leaderboard
from pliant.service.models import Score, Submission, Version
from pliant.service.versions import default_version
from pliant.service.web.state import Site, default_phase, static_file
from pliant.service.web.views import board_csv, hidden_phases
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.staging import staged

_SUBMISSIONS, _STYLE, _KEY = _OTHERS = ("submissions", "service.css", "key.pem")


def write_challenge_site(challenge: Challenge, out: Path) -> list[str]:
    """Write a page and a CSV per version of scoring, and the receipt of each score.

    Only what the service shows to everybody is in it.

    Args:
        challenge: The challenge.
        out: The site's folder: new, empty, or an earlier site, which is replaced.

    Returns:
        The names of the pages.

    Raises:
        CallError: `out` contains something else.
    """
    with challenge.database.read() as session:
        numbers = session.scalars(select(Version.id)).all()
    of_versions = chain(map(_page, numbers), map(_table, numbers))
    keys = {_KEY: challenge.public_key, **{path.name: path for path in challenge.earlier_keys}}
    check_out_dir(out, (INDEX, *_OTHERS, *keys, *of_versions), "site")
    site = Site(challenge)
    pages: list[str] = []
    with challenge.database.read() as session, staged(out) as folder:
        time_ms = log_time(session)
        phase = default_phase(challenge.settings.phases, time_ms)
        first = default_version(session, challenge, phase)
        versions = session.scalars(select(Version).order_by(Version.id)).all()
        hidden = hidden_phases(session, challenge.settings)
        for version in versions:
            rules = challenge.settings.phase(version.phase)
            is_hidden = version.phase in hidden
            board = Board((), ()) if is_hidden else leaderboard(session, version, rules.show)
            page = site.render(
                "board.html.j2",
                who=None,
                plain=True,
                board=board,
                version=version,
                versions=versions,
                phase=rules,
                time_ms=time_ms,
                show=rules.show,
                hidden_until=rules.closes if is_hidden else None,
                first_id=None if first is None else first.id,
                earlier_keys=[name for name in keys if name != _KEY],
            )
            name = INDEX if version is first else _page(version.id)
            pages.append(name)
            (folder / name).write_text(page, encoding="utf-8")
            csv = folder / _table(version.id)
            csv.write_text(board_csv(board, version), encoding="utf-8")
        (folder / _SUBMISSIONS).mkdir()
        public = (
            select(Score.submission_id, Score.version_id, Score.receipt)
            .join(Submission, Submission.id == Score.submission_id)
            .where(Submission.withdrawn_ms.is_(None), Submission.phase.not_in(hidden))
        )
        for number, way, receipt in session.execute(public):
            write_json(folder / _SUBMISSIONS / f"{number}-{way}.json", receipt)
        (folder / _STYLE).write_bytes(static_file(_STYLE))
        for name, path in keys.items():
            (folder / name).write_bytes(path.read_bytes())
    return pages


def _page(version: int) -> str:
    return f"version-{version}.html"


def _table(version: int) -> str:
    return f"leaderboard-{version}.csv"
