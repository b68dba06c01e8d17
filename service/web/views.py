"""The visible part of submissions and leaderboards, as typed documents."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from datetime import datetime
from typing import Any

from pydantic import BaseModel
from sqlalchemy import select
from sqlalchemy.orm import Session

from pliant.service.audit import log_time
from pliant.service.leaderboard import Board, Row
from pliant.service.models import FINAL, Score, State, Submission, Team, Version
from pliant.service.settings import ChallengeSettings
from pliant.service.submissions import NotAcceptedError, queue_position
from pliant.service.teams import Identity
from pliant.spec.errors import Issue

Figures = dict[str, dict[str, float | None]]


class ScoreView(BaseModel):
    """The figures by one version of scoring."""

    version: int
    protocol: str
    protocol_sha256: str
    truth_sha256: str
    figures: Figures
    coverage: float
    scored_ms: int


class SubmissionView(BaseModel):
    """A submission as its team, the host, or (once scored) a visitor sees it."""

    id: int
    team: str
    phase: str
    state: str
    check_only: bool
    queue_position: int | None
    method: str | None
    file_name: str | None
    file_sha256: str
    file_bytes: int
    submitted_ms: int
    finished_ms: int | None
    withdrawn: bool
    issues: list[Issue]
    counts: dict[str, int]
    failure: str | None
    hidden_until: datetime | None
    scores: list[ScoreView]

    @property
    def ended(self) -> bool:
        """Whether its state is final."""
        return self.state in FINAL


class BoardView(BaseModel):
    """The leaderboard of one version of scoring."""

    phase: str
    version: int
    protocol: str
    protocol_sha256: str
    truth_sha256: str
    show: str
    hidden_until: datetime | None
    rows: list[Row]
    controls: list[Row]


def is_own(team_id: int, who: Identity | None) -> bool:
    """Return whether somebody is of a team; the host is of every team."""
    return who is not None and (who.is_host or who.team_id == team_id)


def hidden_until(
    session: Session, settings: ChallengeSettings, phase: str, who: Identity | None
) -> datetime | None:
    """Return until when the scores of a phase are hidden from somebody, or None."""
    rules = settings.phase(phase)
    hidden = rules.hidden_until_close and not (who is not None and who.is_host)
    return rules.closes if hidden and rules.status(log_time(session)) != "closed" else None


def hidden_phases(session: Session, settings: ChallengeSettings) -> list[str]:
    """Return the phases whose scores only the host sees now."""
    names = [phase.name for phase in settings.phases]
    return [name for name in names if hidden_until(session, settings, name, None)]


def find_team(
    session: Session, settings: ChallengeSettings, number: int, who: Identity | None
) -> Team:
    """Return a team that has a submission that everybody may see, or one's own.

    Raises:
        NotAcceptedError: There is none.
    """
    found = session.get(Team, number)
    public = select(Submission.id).where(
        Submission.team_id == number,
        Submission.state == State.SCORED,
        Submission.withdrawn_ms.is_(None),
        Submission.phase.not_in(hidden_phases(session, settings)),
    )
    if found is None or not (is_own(number, who) or session.scalar(public.limit(1))):
        raise NotAcceptedError("NOT_FOUND", 404, "no such team")
    return found


def find_submission(
    session: Session,
    settings: ChallengeSettings,
    number: int,
    who: Identity | None,
    *,
    public: bool = True,
) -> Submission:
    """Return a submission of one's own team, or where `public` one that everybody may see.

    Raises:
        NotAcceptedError: There is none, or it is another team's.
    """
    found = session.get(Submission, number)
    if found is not None:
        shown = public and found.state == State.SCORED and found.withdrawn_ms is None
        shown = shown and not hidden_until(session, settings, found.phase, who)
        if shown or is_own(found.team_id, who):
            return found
    raise NotAcceptedError("NOT_FOUND", 404, "no such submission")


def submission_view(
    session: Session, settings: ChallengeSettings, submission: Submission, who: Identity | None
) -> SubmissionView:
    """Return the visible part of a submission."""
    problems = submission.problems or {}
    hidden = hidden_until(session, settings, submission.phase, who)
    scored = (
        select(Score, Version)
        .join(Version, Version.id == Score.version_id)
        .where(Score.submission_id == submission.id)
        .order_by(Version.id)
    )
    return SubmissionView(
        id=submission.id,
        team=session.get_one(Team, submission.team_id).name,
        phase=submission.phase,
        state=submission.state,
        check_only=submission.check_only,
        queue_position=queue_position(session, submission),
        method=submission.method,
        file_name=submission.file_name if is_own(submission.team_id, who) else None,
        file_sha256=submission.file_sha256,
        file_bytes=submission.file_bytes,
        submitted_ms=submission.created_ms,
        finished_ms=submission.finished_ms,
        withdrawn=submission.withdrawn_ms is not None,
        issues=problems.get("issues", []),
        counts=problems.get("counts", {}),
        failure=submission.failure,
        hidden_until=hidden,
        scores=[] if hidden else [_score_view(*each) for each in session.execute(scored)],
    )


def board_view(
    board: Board, version: Version, show: str, hidden_until: datetime | None
) -> BoardView:
    """Return a leaderboard as a document."""
    return BoardView(
        phase=version.phase,
        **_named(version),
        show=show,
        hidden_until=hidden_until,
        rows=list(board.rows),
        controls=list(board.controls),
    )


def board_csv(board: Board, version: Version) -> str:
    """Return a leaderboard as CSV, the controls last and without a rank."""
    fields = ("rank", "team", "submission", "method", "coverage", "submitted_ms")
    names = [f"{each['group']}.{each['metric']}" for each in version.figures]
    rows = [
        [*(getattr(row, name) for name in fields), *map(row.value, version.figures)]
        for row in (*board.rows, *board.controls)
    ]
    return csv_text([*fields, *names], rows)


def csv_text(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return CSV; a text that a spreadsheet would take for a formula gets an apostrophe."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        writer.writerow(
            f"'{cell}" if isinstance(cell, str) and cell[:1] in "=+-@\t\r" and cell else cell
            for cell in row
        )
    return stream.getvalue()


def _score_view(score: Score, version: Version) -> ScoreView:
    return ScoreView(
        **_named(version),
        figures=score.figures,
        coverage=score.coverage,
        scored_ms=score.scored_ms,
    )


def _named(version: Version) -> dict[str, Any]:
    """Return what names a version of scoring in a document."""
    return {
        "version": version.id,
        "protocol": f"{version.protocol} {version.protocol_version}",
        "protocol_sha256": version.protocol_sha256,
        "truth_sha256": version.truth_sha256,
    }
