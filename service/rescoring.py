"""`pliant challenge rescore`: another protocol, or corrected answers, next to the old scores."""

from __future__ import annotations

from pathlib import Path

from pliant.service.audit import HOST
from pliant.service.challenge import Challenge
from pliant.service.creation import copy_private
from pliant.service.models import Version
from pliant.service.versions import add_version, newest_versions, protocol_text, rescore
from pliant.spec.errors import CallError


def rescore_challenge(
    challenge: Challenge,
    phase: str | None,
    protocol: str | None,
    private: Path | None,
    reason: str,
) -> tuple[list[Version], int]:
    """Add versions of scoring and queue the stored submissions for them.

    Args:
        challenge: The challenge.
        phase: Name of the phase; None takes the first.
        protocol: Name or file of a protocol; None takes those that the phase has.
        private: Private half with corrected answers; None keeps the newest answers.
        reason: Why, shown on the pages.

    Returns:
        The versions, and the number of submissions queued.

    Raises:
        CallError: Neither a protocol nor answers are given.
        SpecError: The answers do not belong to the public half.
    """
    if protocol is None and private is None:
        raise CallError("nothing would change", fix="Give --protocol, --private, or both.")
    rules = challenge.settings.phase(phase) if phase else challenge.settings.phases[0]
    truth = None
    if private is not None:
        truth = 1 + max(int(each.name) for each in challenge.private(1).parent.iterdir())
        copy_private(private, challenge.private(truth))
    with challenge.database.write() as session:
        if protocol is not None:
            texts = [protocol_text(protocol)]
        else:
            texts = [
                challenge.protocol_path(each.protocol_sha256).read_bytes()
                for each in newest_versions(session, rules.name)
            ]
        versions = [
            add_version(session, challenge, rules, text, truth, reason, actor=HOST)
            for text in texts
        ]
        return versions, rescore(session, versions, actor=HOST)
