"""The audit log: events that are only added, each with the hash of the one before."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import select
from sqlalchemy.orm import Session

from pliant.service.database import now_ms
from pliant.service.models import AuditEntry, Score
from pliant.spec.errors import SpecError

FIRST_HASH: Final = "0" * 64
HOST: Final = "host"
SYSTEM: Final = "system"


@dataclass(frozen=True)
class Chain:
    """A verified log: number of its entries, and the hash of the last one."""

    entries: int
    hash: str


def canonical(document: Any) -> str:
    """Return a JSON document as the one text that is hashed and signed."""
    return json.dumps(
        document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    )


def record(session: Session, actor: str, action: str, subject: str, **detail: Any) -> AuditEntry:
    """Add an event, within the transaction of what it describes.

    Args:
        session: A writing session that takes turns.
        actor: Who did it: `host`, `system`, or `team N`.
        action: What was done, such as `submitted`.
        subject: What it was done to, such as `submission 7`.
        **detail: More about it, JSON values; never a token.
    """
    last = last_entry(session)
    entry = AuditEntry(
        seq=1 if last is None else last.seq + 1,
        time_ms=log_time(session),
        actor=actor,
        action=action,
        subject=subject,
        detail=canonical(detail),
        previous=FIRST_HASH if last is None else last.hash,
    )
    entry.hash = entry_hash(entry)
    session.add(entry)
    session.flush()
    return entry


def last_entry(session: Session) -> AuditEntry | None:
    """Return the last event."""
    return session.scalar(select(AuditEntry).order_by(AuditEntry.seq.desc()).limit(1))


def log_time(session: Session) -> int:
    """Return the time, never before that of the last event: a clock set back opens nothing."""
    last = last_entry(session)
    return now_ms() if last is None else max(now_ms(), last.time_ms)


def entry_hash(entry: AuditEntry) -> str:
    """Return the sha256 of an event and of the hash before it."""
    fields = [entry.seq, entry.time_ms, entry.actor, entry.action, entry.subject, entry.detail]
    return hashlib.sha256(canonical([entry.previous, *fields]).encode()).hexdigest()


def verify_chain(entries: Iterable[AuditEntry]) -> Chain:
    """Check that no event was changed, removed or inserted.

    Raises:
        SpecError: An event is not what its hash says; it names the first.
    """
    chain = Chain(0, FIRST_HASH)
    for entry in entries:
        expected = chain.entries + 1
        if entry.seq != expected:
            raise _broken(expected, f"entry {entry.seq}", f"entry {expected}")
        if entry.previous != chain.hash:
            raise _broken(entry.seq, f"previous hash {entry.previous[:16]}…", chain.hash[:16] + "…")
        if entry_hash(entry) != entry.hash:
            raise _broken(entry.seq, f"hash {entry.hash[:16]}…", entry_hash(entry)[:16] + "…")
        chain = Chain(entry.seq, entry.hash)
    return chain


def verify_log(session: Session) -> Chain:
    """Check the chain, and that every stored score is the one that was logged.

    Raises:
        SpecError: Something was changed outside the service.
    """
    entries = session.scalars(select(AuditEntry).order_by(AuditEntry.seq)).all()
    chain = verify_chain(entries)
    logged = {
        (each.subject, detail["version"]): detail["figures_sha256"]
        for each in entries
        if each.action == "scored"
        for detail in [json.loads(each.detail)]
    }
    for score in session.scalars(select(Score)):
        key = (f"submission {score.submission_id}", score.version_id)
        found = figures_sha256(score.figures)
        if logged.pop(key, None) != found:
            raise SpecError(
                "a score is not the one that was logged",
                where=f"{key[0]}, version {key[1]}",
                fix="Restore the last backup, or rescore the submission.",
            )
    if logged:
        subject, version = next(iter(logged))
        raise SpecError("a logged score is missing", where=f"{subject}, version {version}")
    return chain


def figures_sha256(figures: Any) -> str:
    """Return the sha256 of public figures."""
    return hashlib.sha256(canonical(figures).encode()).hexdigest()


def _broken(seq: int, found: str, required: str) -> SpecError:
    return SpecError(
        "the audit log was changed",
        where=f"entry {seq}",
        found=found,
        required=required,
        fix="Compare it with a backup: entries before this one are whole.",
    )
