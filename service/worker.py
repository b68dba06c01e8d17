"""A worker: leases jobs, runs each in a child process, and stores the result."""

from __future__ import annotations

import logging
import os
import signal
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.process import BaseProcess
from typing import Any, Final

from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from pliant.service import queue
from pliant.service.audit import SYSTEM, figures_sha256, log_time, record
from pliant.service.challenge import Challenge
from pliant.service.database import cause, is_unreachable
from pliant.service.models import Job, Score, State, Submission, Team, Version
from pliant.service.queue import Lease
from pliant.service.receipts import Signer
from pliant.service.scoring import Figures, Result, Task, score_in_child
from pliant.service.settings import Scoring
from pliant.service.versions import RESCORE_PRIORITY, kind_of, new_job, newest_versions
from pliant.spec.errors import PliantError
from pliant.spec.limits import LimitError

log = logging.getLogger(__name__)

POLL_S: Final = 0.3
_RETRY_S: Final = 1.0
Scorer = Callable[[Task, Scoring], Result]


class Worker:
    """Does one job after another.

    Args:
        challenge: The challenge.
        scorer: What checks and scores a file.
    """

    def __init__(self, challenge: Challenge, scorer: Scorer = score_in_child) -> None:
        self.challenge = challenge
        self.name = f"{socket.gethostname()}:{os.getpid()}"
        self._scorer = scorer
        self._signer = Signer.read(challenge.private_key)
        self._limits = challenge.settings.scoring
        self._stopping = threading.Event()

    def run(self) -> None:
        """Work until `stop`; a database that cannot be reached is tried again."""
        while not self._stopping.is_set():
            try:
                busy = self.work_once()
            except SQLAlchemyError as error:
                if not is_unreachable(error):
                    raise
                log.warning("the database cannot be used; trying again", extra=cause(error))
                self._stopping.wait(_RETRY_S)
            else:
                if not busy:
                    self._stopping.wait(POLL_S)

    def stop(self) -> None:
        """Finish the present job, then end."""
        self._stopping.set()

    def work_once(self) -> bool:
        """Do the next job; return whether there was one."""
        lease = queue.lease_next(self.challenge.database, self.name, self._limits)
        if lease is None:
            return False
        log.info("job started", extra={"job": lease.job_id, "submission": lease.submission_id})
        started = time.monotonic()
        with _Heartbeat(self.challenge, lease):
            outcome = self._do(lease)
            self._persist(lease, outcome)
        seconds = round(time.monotonic() - started, 3)
        log.info("job ended", extra={"job": lease.job_id, "seconds": seconds})
        return True

    def _do(self, lease: Lease) -> Result | BaseException:
        try:
            with self.challenge.database.read() as session:
                submission = session.get_one(Submission, lease.submission_id)
                wanted = select(Version).where(Version.id.in_(lease.versions))
                versions = list(session.scalars(wanted))
                # Of a check, and of a phase that was new.
                versions = versions or newest_versions(session, submission.phase)
                phase = self.challenge.settings.phase(submission.phase)
                time_ms = log_time(session)
                others = tuple(
                    (each.name, each.split, kind_of(self.challenge, way))
                    for each in self.challenge.settings.phases
                    if each is not phase and each.status(time_ms) == "open"
                    for way in newest_versions(session, each.name)[:1]
                )
                ways = tuple(
                    (
                        each.id,
                        self.challenge.protocol_path(each.protocol_sha256).read_bytes(),
                        self.challenge.private(each.truth),
                    )
                    for each in versions
                )
                session.expunge_all()
            task = Task(
                file=self.challenge.store.path(submission.file_sha256),
                name=submission.file_name,
                public=self.challenge.public,
                phase=phase.name,
                split=phase.split,
                kind=kind_of(self.challenge, versions[0]),
                versions=() if submission.check_only else ways,
                others=others,
            )
            return self._scorer(task, self._limits)
        except SQLAlchemyError:
            raise
        except Exception as error:
            return error

    def _persist(self, lease: Lease, outcome: Result | BaseException) -> None:
        """Store an outcome, for as long as the lease is valid, however long that takes."""
        while True:
            try:
                self._store(lease, outcome)
                return
            except SQLAlchemyError as error:
                if not is_unreachable(error):
                    raise
                log.warning("the database cannot be used; the result is kept", extra=cause(error))
                time.sleep(_RETRY_S)

    def _store(self, lease: Lease, outcome: Result | BaseException) -> None:
        database = self.challenge.database
        if isinstance(outcome, Result):
            with database.write() as session:
                job = queue.held(session, lease)
                if job is not None:
                    self._finish(session, job, outcome)
            return
        error, final = str(outcome), isinstance(outcome, PliantError)
        if isinstance(outcome, LimitError):  # its path is the file's name, which no log contains
            error, final = outcome.without_place(), outcome.reason != "crash"
        error = f"{type(outcome).__name__}: {error}"
        log.error("job failed", extra={"job": lease.job_id, "error": error})
        if not final and lease.tries < self._limits.tries:
            later = isinstance(outcome, OSError)  # a full disk must not fail all that waits
            queue.release_job(database, lease, error[:2000], later=later)
            return
        shown = "Scoring failed. The host sees why; no attempt was charged."
        if isinstance(outcome, LimitError):
            shown = f"Scoring failed: {outcome}. No attempt was charged."
        queue.fail(database, lease, error, shown)

    def _finish(self, session: Session, job: Job, result: Result) -> None:
        submission = session.get_one(Submission, job.submission_id)
        subject = f"submission {submission.id}"
        if result.method is not None and submission.method is None:
            submission.method = result.method[:200]
        if result.issues:
            queue.finish(session, job, State.REFUSED)
            if submission.state == State.REFUSED:
                submission.problems = {"issues": list(result.issues), "counts": result.counts}
            record(session, SYSTEM, "refused", subject, counts=result.counts)
            return
        for version_id, figures in (result.figures or {}).items():
            self._add_score(session, submission, version_id, figures, result)
        is_new = submission.finished_ms is None
        queue.finish(session, job, State.CHECKED if submission.check_only else State.SCORED)
        if submission.check_only:
            record(session, SYSTEM, "checked", subject)
        elif is_new:  # `rescore` leaves out what is not scored yet
            newest = [each.id for each in newest_versions(session, submission.phase)]
            if later := [each for each in newest if each not in (result.figures or {})]:
                session.add(new_job(submission, later, RESCORE_PRIORITY))

    def _add_score(
        self,
        session: Session,
        submission: Submission,
        version_id: int,
        figures: Figures,
        result: Result,
    ) -> None:
        same = select(Score.id).where(
            Score.submission_id == submission.id, Score.version_id == version_id
        )
        if session.scalar(same) is not None:
            return
        version = session.get_one(Version, version_id)
        entry = record(
            session,
            SYSTEM,
            "scored",
            f"submission {submission.id}",
            version=version_id,
            figures_sha256=figures_sha256(figures),
        )
        receipt: dict[str, Any] = {
            "challenge": self.challenge.title,
            "submission": submission.id,
            "team": session.get_one(Team, submission.team_id).name,
            "phase": submission.phase,
            "method": submission.method,
            "file_sha256": submission.file_sha256,
            "queries_sha256": result.queries_sha256,
            "truth_sha256": version.truth_sha256,
            "protocol": {
                "name": version.protocol,
                "version": version.protocol_version,
                "sha256": version.protocol_sha256,
            },
            "evaluator": result.tools,
            "figures": figures,
            "coverage": result.coverage,
            "submitted_ms": submission.created_ms,
            "scored_ms": entry.time_ms,
            "audit": {"entry": entry.seq, "hash": entry.hash},
        }
        session.add(
            Score(
                submission_id=submission.id,
                version_id=version_id,
                figures=figures,
                main=figures["overall"].get(version.figures[0]["metric"]),
                coverage=result.coverage,
                receipt=self._signer.sign(receipt),
                scored_ms=log_time(session),
            )
        )


class _Heartbeat:
    """Renews a lease while its job is being done."""

    def __init__(self, challenge: Challenge, lease: Lease) -> None:
        self._challenge, self._lease = challenge, lease
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._beat, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *exc: object) -> None:
        self._ended.set()
        self._thread.join()

    def _beat(self) -> None:
        limits = self._challenge.settings.scoring
        while not self._ended.wait(limits.lease_s / 3):
            with suppress(SQLAlchemyError):  # the database may be back before the lease ends
                if not queue.renew(self._challenge.database, self._lease, limits):
                    return


def run_worker(challenge: Challenge, parent: BaseProcess | None = None) -> None:
    """Work until SIGTERM or SIGINT, or until a parent process ends; the present job is finished."""
    worker = Worker(challenge)
    for each in (signal.SIGTERM, signal.SIGINT):
        signal.signal(each, lambda *_: worker.stop())
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # as `Workers` starts it
    if parent is not None:
        threading.Thread(target=_stop_after, args=(worker, parent), daemon=True).start()
    worker.run()


def _stop_after(worker: Worker, parent: BaseProcess) -> None:
    parent.join()
    worker.stop()
