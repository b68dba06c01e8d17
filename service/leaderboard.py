"""The leaderboard: one scored submission of each team by one version, and the controls apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel
from sqlalchemy import Select, case, func, select
from sqlalchemy.orm import Session

from pliant.service.models import Score, Submission, Team, Version


class Row(BaseModel):
    """One line.

    Attributes:
        rank: Place, equal figures share one; None for a control, and for a submission without the
            figure that ranks.
        team_id: The team.
        team: Its name.
        submission: The submission shown.
        method: Name of its method.
        figures: Group -> metric -> value.
        coverage: Share of the queries that it answers.
        submitted_ms: When it was sent.
        submissions: Scored submissions of the team by this version.
    """

    rank: int | None
    team_id: int
    team: str
    submission: int
    method: str
    figures: dict[str, dict[str, float | None]]
    coverage: float
    submitted_ms: int
    submissions: int

    def value(self, figure: dict[str, Any]) -> float | None:
        """Return the value of a figure of `Version.figures`."""
        return self.figures.get(figure["group"], {}).get(figure["metric"])


@dataclass(frozen=True)
class Board:
    """The lines of one version, the best first.

    Attributes:
        rows: One per team.
        controls: Submissions of the host, one per method, not ranked.
    """

    rows: tuple[Row, ...]
    controls: tuple[Row, ...]


def leaderboard(session: Session, version: Version, show: str) -> Board:
    """Return the leaderboard of a version.

    Args:
        session: A session.
        version: The version.
        show: `best` or `last` submission of each team.
    """
    team = case((Team.is_host, Submission.method), else_=None)
    order = (Score.submission_id.desc(),) if show == "last" else _best_first(version)
    place = func.row_number().over(partition_by=(Submission.team_id, team), order_by=order)
    count = func.count().over(partition_by=(Submission.team_id, team))
    inner = (
        _scored(version)
        .with_only_columns(Score.id.label("id"), place.label("place"), count.label("count"))
        .subquery()
    )
    chosen = (
        select(Score, Submission, Team, inner.c.count)
        .join(inner, inner.c.id == Score.id)
        .join(Submission, Submission.id == Score.submission_id)
        .join(Team, Team.id == Submission.team_id)
        .where(inner.c.place == 1)
        .order_by(*_best_first(version))
    )
    rows: list[Row] = []
    controls: list[Row] = []
    previous: tuple[float | None, int] = (None, 0)
    for score, submission, owner, submissions in session.execute(chosen):
        rank = None
        if not owner.is_host and score.main is not None:
            rank = previous[1] if score.main == previous[0] else len(rows) + 1
            previous = (score.main, rank)
        row = _row(score, submission, owner, submissions, rank)
        (controls if owner.is_host else rows).append(row)
    return Board(tuple(rows), tuple(controls))


def history(session: Session, version: Version, team_id: int) -> list[Row]:
    """Return the scored submissions of a team, the last first."""
    found = (
        _scored(version)
        .where(Submission.team_id == team_id)
        .order_by(Submission.id.desc())
        .with_only_columns(Score, Submission, Team)
    )
    return [_row(*each, 1, None) for each in session.execute(found)]


def _scored(version: Version) -> Select[Any]:
    return (
        select(Score)
        .join(Submission, Submission.id == Score.submission_id)
        .join(Team, Team.id == Submission.team_id)
        .where(Score.version_id == version.id, Submission.withdrawn_ms.is_(None))
    )


def _best_first(version: Version) -> tuple[Any, ...]:
    higher = version.figures[0]["better"] == "higher"
    return Score.main.is_(None), Score.main.desc() if higher else Score.main, Score.submission_id


def _row(
    score: Score, submission: Submission, team: Team, submissions: int, rank: int | None
) -> Row:
    return Row(
        rank=rank,
        team_id=team.id,
        team=team.name,
        submission=submission.id,
        method=submission.method or "",
        figures=score.figures,
        coverage=score.coverage,
        submitted_ms=submission.created_ms,
        submissions=submissions,
    )
