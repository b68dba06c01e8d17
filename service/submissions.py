"""Accepts submissions, reports their state, and withdraws them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from pliant.service.audit import log_time, record
from pliant.service.challenge import Challenge
from pliant.service.ledger import attempts, charge
from pliant.service.models import FINAL, Job, State, Submission
from pliant.service.settings import ChallengeSettings, Phase, moment_text
from pliant.service.teams import Identity
from pliant.service.versions import new_job, newest_versions
from pliant.spec.errors import CallError

_MINUTE_MS: Final = 60_000


class NotAcceptedError(CallError):
    """A file is not accepted; nothing is charged.

    Attributes:
        code: Stable code.
        status: HTTP status.
    """

    def __init__(self, code: str, status: int, message: str, **kwargs: Any) -> None:
        self.code = code
        self.status = status
        super().__init__(message, **kwargs)


@dataclass(frozen=True)
class Upload:
    """A file that has arrived whole.

    Attributes:
        sha256: Its sha256; the store has it under this name.
        name: Its name on the participant's machine.
        bytes: Its size.
        check_only: Whether it is only checked.
    """

    sha256: str
    name: str
    bytes: int
    check_only: bool


def check_allowed(
    session: Session,
    settings: ChallengeSettings,
    phase: Phase,
    who: Identity,
    *,
    check_only: bool,
) -> int:
    """Refuse a submission that the rules do not allow now; return the time it counts for.

    Raises:
        NotAcceptedError: The phase is not open, too many files in this minute, or no attempt left.
    """
    time_ms = log_time(session)
    status = phase.status(time_ms)
    if status != "open" and not who.is_host:
        when = phase.opens if status == "upcoming" else phase.closes
        raise NotAcceptedError(
            "PHASE_NOT_OPEN",
            403,
            f"phase {phase.name} is {status}",
            found=f"{'opens' if status == 'upcoming' else 'closed'} {moment_text(when)}",
        )
    recent = session.scalar(
        select(func.count())
        .select_from(Submission)
        .where(Submission.team_id == who.team_id, Submission.created_ms > time_ms - _MINUTE_MS)
    )
    if (recent or 0) >= settings.submissions_per_minute:
        raise NotAcceptedError(
            "TOO_MANY_REQUESTS",
            429,
            "too many files in one minute",
            required=f"at most {settings.submissions_per_minute}",
            fix="Wait a minute.",
        )
    left = attempts(session, who.team_id, phase, time_ms)
    if not check_only and not who.is_host and left.left < 1:
        raise NotAcceptedError(
            "QUOTA_EXCEEDED",
            429,
            "no attempt is left" if left.total < 1 else "no attempt is left today",
            required=f"{phase.attempts_per_day} per UTC day, {phase.attempts_total} in all",
            fix=_held(session, phase, who)
            + ("Ask the host for a credit." if left.total < 1 else "Attempts renew at 00:00 UTC."),
        )
    return time_ms


def _held(session: Session, phase: Phase, who: Identity) -> str:
    """Return a sentence on attempts that files hold until they are checked, or nothing."""
    waiting = session.scalar(
        select(func.count())
        .select_from(Submission)
        .where(
            Submission.team_id == who.team_id,
            Submission.phase == phase.name,
            Submission.state.not_in(FINAL),
            Submission.check_only.is_(False),
        )
    )
    if not waiting:
        return ""
    return f"Wait for your files in the queue ({waiting}): a refused one gives its attempt back. "


def has_file_of_size(session: Session, phase: Phase, who: Identity, size: int | None) -> bool:
    """Return whether a team has sent a file of a size (bytes) before, perhaps the same one."""
    same_size = select(Submission.id).where(
        Submission.team_id == who.team_id,
        Submission.phase == phase.name,
        Submission.file_bytes == size,
    )
    return session.scalar(same_size.limit(1)) is not None


def sent_before(session: Session, phase: Phase, who: Identity, upload: Upload) -> Submission | None:
    """Return the submission that a team made of the same file, unless it was refused or failed.

    A refused file is checked again, because the rules may have changed since.
    """
    return session.scalar(
        select(Submission)
        .where(
            Submission.team_id == who.team_id,
            Submission.phase == phase.name,
            Submission.file_sha256 == upload.sha256,
            Submission.check_only == upload.check_only,
            Submission.state.not_in((State.FAILED, State.REFUSED)),
            Submission.withdrawn_ms.is_(None),
        )
        .order_by(Submission.id.desc())
    )


def accept(
    session: Session, challenge: Challenge, phase: Phase, who: Identity, upload: Upload
) -> tuple[Submission, bool]:
    """Accept a file: its row, its charge, its job and its log entry are stored together or not.

    The same file of the same team in the same phase is one submission, whatever the number of
    times it is sent, unless it was refused or failed, so a client that lost the answer can send it
    again.

    Returns:
        The submission, and whether it is new.

    Raises:
        NotAcceptedError: As `check_allowed`.
    """
    earlier = sent_before(session, phase, who, upload)
    if earlier is not None:
        return earlier, False
    time_ms = check_allowed(session, challenge.settings, phase, who, check_only=upload.check_only)
    submission = Submission(
        team_id=who.team_id,
        phase=phase.name,
        file_sha256=upload.sha256,
        file_name=upload.name,
        file_bytes=upload.bytes,
        check_only=upload.check_only,
        state=State.QUEUED,
        created_ms=time_ms,
    )
    session.add(submission)
    session.flush()
    if not upload.check_only and not who.is_host:
        charge(session, submission)
    versions = [] if upload.check_only else newest_versions(session, phase.name)
    session.add(new_job(submission, [each.id for each in versions], 0))
    record(
        session,
        who.actor,
        "sent a check" if upload.check_only else "submitted",
        f"submission {submission.id}",
        phase=phase.name,
        file_sha256=upload.sha256,
        bytes=upload.bytes,
    )
    return submission, True


def withdraw(session: Session, submission_id: int, *, actor: str) -> Submission:
    """Take a submission off the leaderboard; its row, file and scores stay.

    Raises:
        CallError: There is none, or it is withdrawn already.
    """
    submission = session.get(Submission, submission_id)
    if submission is None or submission.withdrawn_ms is not None:
        raise CallError("no such submission, or it is withdrawn already", found=submission_id)
    submission.withdrawn_ms = log_time(session)
    record(session, actor, "withdrawn", f"submission {submission_id}")
    return submission


def queue_position(session: Session, submission: Submission) -> int | None:
    """Return how many jobs are before a submission's, plus one; None when it does not wait."""
    if submission.state in FINAL:
        return None
    job = session.scalar(
        select(Job)
        .where(Job.submission_id == submission.id, Job.state == "queued")
        .order_by(Job.id)
    )
    if job is None:
        return None
    before = (Job.priority < job.priority) | ((Job.priority == job.priority) & (Job.id < job.id))
    count = select(func.count()).select_from(Job).where(Job.state == "queued", before)
    return (session.scalar(count) or 0) + 1
