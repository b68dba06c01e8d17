"""`pliant challenge rescore`: another protocol, or corrected answers, next to the old scores."""

from __future__ import annotations

from pathlib import Path

from pliant.evaluator.protocols.protocol import protocol_text
from pliant.service.audit import HOST
from pliant.service.challenge import Challenge
from pliant.service.creation import copy_private
from pliant.service.models import Version
from pliant.service.versions import add_version, newest_versions, rescore
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.staging import discard


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
        CallError: Neither a protocol nor answers are given, or no reason.
        SpecError: The answers do not belong to the public half.
    """
    if protocol is None and private is None:
        raise CallError("nothing would change", fix="Give --protocol, --private, or both.")
    rules = challenge.settings.phase(phase) if phase else challenge.settings.phases[0]
    truth = None
    if private is not None:
        Dataset.open(challenge.public).with_private(private)
        truth = 1 + max(int(each.name) for each in challenge.private(1).parent.iterdir())
        copy_private(private, challenge.private(truth))
    versions: list[Version] = []
    try:
        with challenge.database.write() as session:
            if protocol is not None:
                texts = [protocol_text(protocol)]
            else:
                texts = [
                    challenge.protocol_path(each.protocol_sha256).read_bytes()
                    for each in newest_versions(session, rules.name)
                ]
            found = [
                add_version(session, challenge, rules, text, truth, reason, actor=HOST)
                for text in texts
            ]
            count = rescore(session, found, actor=HOST)
        versions = found
    finally:
        if truth is not None and truth not in {each.truth for each in versions}:
            discard(challenge.private(truth))  # refused, or the answers that there are already
    return versions, count
