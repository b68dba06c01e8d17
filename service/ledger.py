"""Attempts: a ledger of charges, refunds and credits, read and written in one transaction."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import case, func, select
from sqlalchemy.orm import Session

from pliant.service.audit import record
from pliant.service.models import LedgerEntry, Submission
from pliant.service.settings import Phase
from pliant.spec.errors import CallError

CHARGE, REFUND, CREDIT = "submit", "refund", "credit"
_LARGEST_CREDIT = 10_000


@dataclass(frozen=True)
class Attempts:
    """What a team has left in a phase.

    Attributes:
        today: On the present UTC day.
        total: In all.
        overdrawn: How many more it has used than the rules allow now, which may have changed.
    """

    today: int
    total: int
    overdrawn: int = 0

    @property
    def left(self) -> int:
        """Submissions that may be sent now."""
        return min(self.today, self.total)


def attempts(session: Session, team_id: int, phase: Phase, time_ms: int) -> Attempts:
    """Return what a team has left in a phase at a time."""
    today = func.sum(case((LedgerEntry.day == utc_day(time_ms), LedgerEntry.amount), else_=0))
    row = session.execute(
        select(func.coalesce(today, 0), func.coalesce(func.sum(LedgerEntry.amount), 0)).where(
            LedgerEntry.team_id == team_id, LedgerEntry.phase == phase.name
        )
    ).one()
    left, total = phase.attempts_per_day + int(row[0]), phase.attempts_total + int(row[1])
    return Attempts(max(0, left), max(0, total), max(0, -left, -total))


def charge(session: Session, submission: Submission) -> None:
    """Charge a submission's team one attempt."""
    _add(session, submission, CHARGE, -1, submission.created_ms)


def refund(session: Session, submission: Submission, time_ms: int) -> None:
    """Give the attempt of a submission back, for the day on which it was charged."""
    _add(session, submission, REFUND, 1, time_ms)


def credit(
    session: Session, team_id: int, phase: Phase, amount: int, time_ms: int, *, actor: str
) -> None:
    """Give a team more attempts: in all, and on the present day beyond the daily number.

    What it has used beyond the present rules is forgiven.

    Raises:
        CallError: The number is out of range.
    """
    if not 1 <= amount <= _LARGEST_CREDIT:
        raise CallError(
            "the number of attempts is out of range",
            found=amount,
            required=f"1 to {_LARGEST_CREDIT:,}",
        )
    overdrawn = attempts(session, team_id, phase, time_ms).overdrawn
    session.add(
        LedgerEntry(
            team_id=team_id,
            phase=phase.name,
            submission_id=None,
            kind=CREDIT,
            amount=amount + overdrawn,
            day=utc_day(time_ms),
            created_ms=time_ms,
        )
    )
    detail = {"phase": phase.name, "amount": amount, "forgiven": overdrawn}
    record(session, actor, "credited", f"team {team_id}", **detail)


def utc_day(time_ms: int) -> str:
    """Return the UTC day of a time, `YYYY-MM-DD`."""
    return datetime.fromtimestamp(time_ms / 1000, UTC).date().isoformat()


def _add(session: Session, submission: Submission, kind: str, amount: int, time_ms: int) -> None:
    session.add(
        LedgerEntry(
            team_id=submission.team_id,
            phase=submission.phase,
            submission_id=submission.id,
            kind=kind,
            amount=amount,
            day=utc_day(submission.created_ms),
            created_ms=time_ms,
        )
    )
