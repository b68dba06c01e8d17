"""What a challenge contains, and the scoring of a submission, for the faults' commands."""

from __future__ import annotations

import hashlib
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from sqlalchemy import func, select, text
from sqlalchemy.exc import SQLAlchemyError

from pliant.service import worker as worker_module
from pliant.service.audit import verify_log
from pliant.service.challenge import Challenge
from pliant.service.ledger import CREDIT
from pliant.service.models import Job, LedgerEntry, Score, Submission, Team, Token
from pliant.service.scoring import score
from pliant.service.submissions import Upload, accept
from pliant.service.teams import Identity, invite
from pliant.service.worker import Worker
from pliant.spec.errors import PliantError


@contextmanager
def opened(root: Path) -> Iterator[Challenge]:
    """Open a challenge, and close its database at the end."""
    challenge = Challenge.open(root, None)
    try:
        yield challenge
    finally:
        challenge.database.engine.dispose()


def books(root: Path) -> Any:
    """Return what a challenge contains, but random keys and tokens; check its audit log."""
    with opened(root) as challenge, challenge.database.read() as session:
        verify_log(session)
        tables = (Token, Submission, Score, LedgerEntry)
        return (
            sorted(path.name for path in (root / "keys").iterdir()),
            sorted(session.scalars(select(Team.name))),
            [session.scalar(select(func.count()).select_from(each)) for each in tables],
            sorted(session.scalars(select(Submission.state))),
            sorted(session.scalars(select(Job.state))),
            [each.figures for each in session.scalars(select(Score))],
            session.scalar(select(func.sum(LedgerEntry.amount))),
        )


def credits_of(root: Path) -> int:
    """Return the attempts that were given in a challenge."""
    with opened(root) as challenge, challenge.database.read() as session:
        given = select(func.sum(LedgerEntry.amount)).where(LedgerEntry.kind == CREDIT)
        return session.scalar(given) or 0


def send(root: Path, file: Path) -> None:
    """Put a submission into the queue, as the web process does."""
    sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
    upload = Upload(sha256, "given.parquet", file.stat().st_size, False)
    with opened(root) as challenge, challenge.database.write() as session:
        incoming = challenge.incoming / "given.parquet"
        shutil.copyfile(file, incoming)
        challenge.store.put(incoming, sha256)
        incoming.unlink()
        team = invite(session, "Team", actor="host")[0]
        who = Identity(team.id, team.name, False, "none")
        accept(session, challenge, challenge.settings.phases[0], who, upload)


def work(root: Path) -> int:
    """Score what waits, in this process; a job whose worker was killed waits again at once.

    A worker keeps a result until the database takes it: here it ends instead of waiting.
    """

    def sleep(_: float) -> None:
        raise TimeoutError("the database does not take the result")

    vars(worker_module)["time"] = SimpleNamespace(sleep=sleep, monotonic=time.monotonic)
    try:
        with opened(root) as challenge:
            with challenge.database.write() as session:
                session.execute(text("UPDATE job SET lease_until_ms = 0 WHERE state = 'leased'"))
            worker = Worker(challenge, lambda task, limits: score(task))
            while worker.work_once():
                pass
    except (SQLAlchemyError, PliantError, OSError) as error:
        print(f"Error: {error}")
        return 2
    return 0
