"""The queue: rows that workers lease, renew and finish.

A lease ends unless it is renewed, so a job whose worker was killed goes to another one. A worker
that comes back late cannot finish the job: its lease is no longer the row's.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from typing import Final

from sqlalchemy import Select, or_, select
from sqlalchemy.orm import Session

from pliant.service.audit import SYSTEM, log_time, record
from pliant.service.database import Database, now_ms
from pliant.service.ledger import CHARGE, refund
from pliant.service.models import Job, LedgerEntry, State, Submission
from pliant.service.settings import Scoring

_CLOCKS_DIFFER_MS: Final = 60_000
"""How far the clocks of two machines that work on one queue may be apart."""


@dataclass(frozen=True)
class Lease:
    """The right to finish a job.

    Attributes:
        job_id: The job.
        key: What the row must contain for it to be valid.
        tries: Number of this try.
        submission_id: The submission.
        versions: Ids of the versions to score by; empty for a check.
    """

    job_id: int
    key: str
    tries: int
    submission_id: int
    versions: tuple[int, ...]


def lease_next(database: Database, worker: str, limits: Scoring) -> Lease | None:
    """Take the next job that waits, or one whose lease has ended.

    A job that was leased as often as is allowed fails instead.
    """
    with database.read() as session:  # most polls find nothing: they take no lock
        if session.scalar(_waiting(limits).limit(1)) is None:
            return None
    with database.write(take_turns=False) as session:
        job = session.scalar(_waiting(limits).limit(1).with_for_update(skip_locked=True))
        if job is None:
            return None
        exhausted = job.tries >= limits.tries
        job.state, job.worker, job.lease = "leased", worker, secrets.token_hex(8)
        job.lease_until_ms = now_ms() + int(limits.lease_s * 1000)
        if not exhausted:
            job.tries += 1
            submission = session.get_one(Submission, job.submission_id)
            if submission.state == State.QUEUED:
                submission.state = State.RUNNING
        lease = Lease(job.id, job.lease, job.tries, job.submission_id, tuple(job.versions))
    if not exhausted:
        return lease
    fail(database, lease, f"its worker stopped {lease.tries} times", _STOPPED)
    return None


def renew(database: Database, lease: Lease, limits: Scoring) -> bool:
    """Extend a lease; return whether it is still valid."""
    with database.write(take_turns=False) as session:
        job = held(session, lease)
        if job is not None:
            job.lease_until_ms = now_ms() + int(limits.lease_s * 1000)
        return job is not None


def release_job(database: Database, lease: Lease, error: str, *, later: bool) -> None:
    """Let another worker take a job; this try counts.

    Args:
        database: The database.
        lease: The job's lease.
        error: What happened, for the host.
        later: Whether the lease runs out first: the next try would meet the same fault now.
    """
    with database.write(take_turns=False) as session:
        job = held(session, lease)
        if job is None:
            return
        job.error = error
        if later:
            return
        job.state, job.lease, job.lease_until_ms = "queued", None, None
        submission = session.get_one(Submission, job.submission_id)
        if submission.state == State.RUNNING:
            submission.state = State.QUEUED


def fail(database: Database, lease: Lease, error: str, shown: str) -> None:
    """End a job that cannot be done; the attempt is refunded.

    Args:
        database: The database.
        lease: The job's lease.
        error: What happened, for the host.
        shown: What the participant reads.
    """
    with database.write() as session:
        job = held(session, lease)
        if job is None:
            return
        job.error = error[:2000]
        submission = finish(session, job, State.FAILED)
        if submission.state == State.FAILED:
            submission.failure = shown
        subject = f"submission {submission.id}"
        record(session, SYSTEM, "failed", subject, job=job.id, error=error[:300])


def finish(session: Session, job: Job, state: State) -> Submission:
    """End a job and put its submission into a final state, which a rescored one has already.

    A submission that is not scored gets its attempt back.
    """
    job.state = "failed" if state == State.FAILED else "done"
    job.lease = job.lease_until_ms = None
    submission = session.get_one(Submission, job.submission_id)
    if submission.finished_ms is None:
        submission.state = state
        submission.finished_ms = log_time(session)
        charged = select(LedgerEntry.id).where(
            LedgerEntry.submission_id == submission.id, LedgerEntry.kind == CHARGE
        )
        if state != State.SCORED and session.scalar(charged) is not None:
            refund(session, submission, submission.finished_ms)
    return submission


def held(session: Session, lease: Lease) -> Job | None:
    """Return a lease's job, locked, if the lease is still valid."""
    return session.scalar(
        select(Job)
        .where(Job.id == lease.job_id, Job.lease == lease.key, Job.state == "leased")
        .with_for_update()
    )


_STOPPED = "Scoring stopped several times. The host sees why; no attempt was charged."


def _waiting(limits: Scoring) -> Select[Job]:
    now = now_ms()
    # A lease that lasts longer than any was made before the clock was set back.
    longest = now + int(2000 * limits.lease_s) + _CLOCKS_DIFFER_MS
    over = or_(Job.lease_until_ms < now, Job.lease_until_ms > longest)
    ended = (Job.state == "leased") & over
    return select(Job).where(or_(Job.state == "queued", ended)).order_by(Job.priority, Job.id)
