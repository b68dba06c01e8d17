"""Versions of scoring: a protocol and a truth, side by side with earlier ones, never in place."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from pliant.evaluator import PROTOCOL_NAMES
from pliant.evaluator.protocols.protocol import Protocol, parse_protocol, protocol_text
from pliant.evaluator.submission.queries import read_queries
from pliant.service.audit import HOST, log_time, record
from pliant.service.challenge import CHALLENGE_YAML, Challenge
from pliant.service.models import Job, Score, State, Submission, Version
from pliant.service.settings import ChallengeSettings, Phase
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage import layout

RESCORE_PRIORITY = 1


def texts_of_protocols(phase: Phase, path: Path | None) -> list[bytes]:
    """Return the texts of a phase's protocols.

    Args:
        phase: The phase.
        path: The rules that name it, as for `protocol_text`.

    Raises:
        CallError: A protocol is neither built in nor a file.
    """
    where = f"phase {phase.name}, protocols"
    return [protocol_text(name, path, where) for name in phase.protocols]


def with_own_protocols(
    settings: ChallengeSettings, path: Path | None
) -> tuple[ChallengeSettings, dict[str, bytes]]:
    """Return rules that name protocol files by their copies in the challenge, and the copies.

    Args:
        settings: The rules of a new challenge.
        path: Their file, as for `protocol_text`.

    Returns:
        The rules, and path in the challenge -> content.

    Raises:
        CallError: A protocol is neither built in nor a file, or a setting of it is refused.
    """
    copies: dict[str, bytes] = {}
    phases = []
    for phase in settings.phases:
        names = list(phase.protocols)
        for index, text in enumerate(texts_of_protocols(phase, path)):
            if names[index] not in PROTOCOL_NAMES:
                names[index] = f"protocols/{parse_protocol(text).sha256}.json"
                copies[names[index]] = text
        phases.append(phase.replace(protocols=tuple(names)))
    return settings.replace(phases=tuple(phases)), copies


def add_version(
    session: Session,
    challenge: Challenge,
    phase: Phase,
    text: bytes,
    truth: int | None,
    reason: str,
    *,
    actor: str,
) -> Version:
    """Add a way to score a phase, or return the one that exists.

    Args:
        session: A writing session.
        challenge: The challenge.
        phase: The phase.
        text: The protocol.
        truth: Number of the truth, whose file is read; None takes the newest one of the phase,
            whose sha256 is known.
        reason: Why, shown on pages.
        actor: Who asks for it.

    Raises:
        CallError: The reason is empty, the protocol scores episodes and the split has none, or the
            phase's other protocols score another kind of submission, so that none could be scored
            by all.
        SpecError: The halves do not belong together, or have no queries or no truth of the split.
    """
    if not reason.strip():
        raise CallError("the reason is empty", fix="State why: the pages show it.")
    protocol = parse_protocol(text)
    dataset = Dataset.open(challenge.public)
    if phase.split not in dataset.splits_with_queries():
        raise SpecError(f"the public half has no queries of split {phase.split}")
    queries = read_queries(dataset, phase.split)
    protocol.check_episodes(dataset, phase.split, queries, allow_empty=False)  # it may rank by any
    known = versions_of(session, phase.name)
    if known:
        _check_kind(protocol, kind_of(challenge, known[0]), phase)
    if truth is None:
        newest = known[-1]
        truth, truth_sha256 = newest.truth, newest.truth_sha256
    else:
        truth_sha256 = sha256_file(truth_file(dataset, challenge.private(truth), phase.split))
    same = select(Version).where(
        Version.phase == phase.name,
        Version.protocol_sha256 == protocol.sha256,
        Version.truth_sha256 == truth_sha256,
    )
    version = session.scalar(same)
    if version is not None:
        return version
    stored = challenge.protocol_path(protocol.sha256)
    if not stored.exists():
        stored.write_bytes(text)
    version = Version(
        phase=phase.name,
        protocol=protocol.name,
        protocol_version=protocol.version,
        protocol_sha256=protocol.sha256,
        truth=truth,
        truth_sha256=truth_sha256,
        figures=_figures(protocol, dataset, phase.split),
        reason=reason,
        created_ms=log_time(session),
    )
    session.add(version)
    session.flush()
    record(
        session,
        actor,
        "version added",
        f"version {version.id}",
        phase=phase.name,
        protocol=f"{protocol.name} {protocol.version}",
        protocol_sha256=protocol.sha256,
        truth_sha256=truth_sha256,
        reason=reason,
    )
    return version


def _check_kind(protocol: Protocol, kind: str, phase: Phase) -> None:
    if protocol.kind != kind:
        raise CallError(
            "the protocols of a phase score one kind of submission",
            where=f"phase {phase.name}",
            found=f"{protocol.name} for {protocol.kind}",
            required=f"a protocol for {kind}",
            fix="Give the other kind a phase of its own.",
        )


def add_missing_versions(session: Session, challenge: Challenge) -> None:
    """Add versions for the phases and protocols of `challenge.yaml` that have none yet.

    What a phase has scored before is queued for a protocol that is new in it, or a file with
    another content. A built-in one stays as it was when the phase began.

    Raises:
        CallError: A phase has another truth than its versions, or `add_version` refuses one.
    """
    dataset = Dataset.open(challenge.public)
    for phase in challenge.settings.phases:
        known = versions_of(session, phase.name)
        truth = max(
            (each.truth for each in known), default=_newest_truth(session, challenge, phase)
        )
        path = truth_file(dataset, challenge.private(truth), phase.split)
        if known and sha256_file(path) not in {each.truth_sha256 for each in known}:
            raise CallError(
                "the truth of a phase is not the one of its scores",
                path=path,
                where=f"phase {phase.name}",
                fix="Give another split a phase of its own; correct answers with: "
                "pliant challenge rescore",
            )
        texts = texts_of_protocols(phase, challenge.root / CHALLENGE_YAML)
        for name, text in zip(phase.protocols, texts, strict=True):
            protocol = parse_protocol(text)
            same = {each.protocol_sha256 for each in known if each.protocol == protocol.name}
            if same and (name in PROTOCOL_NAMES or protocol.sha256 in same):
                continue
            reason = "added to the rules" if known else "initial scoring"
            version = add_version(session, challenge, phase, text, truth, reason, actor=HOST)
            if known:
                rescore(session, [version], actor=HOST)


def _newest_truth(session: Session, challenge: Challenge, phase: Phase) -> int:
    """Return the number of the truth of a new phase: the newest that its split has."""
    same = [each.name for each in challenge.settings.phases if each.split == phase.split]
    newest = select(func.max(Version.truth)).where(Version.phase.in_(same))
    return session.scalar(newest) or 1


def versions_of(session: Session, phase: str) -> list[Version]:
    """Return the versions of a phase, first ones first."""
    return list(session.scalars(select(Version).where(Version.phase == phase).order_by(Version.id)))


def newest_versions(session: Session, phase: str) -> list[Version]:
    """Return the versions that a new submission is scored by: the newest of each protocol."""
    return list({each.protocol: each for each in versions_of(session, phase)}.values())


def default_version(session: Session, challenge: Challenge, phase: Phase) -> Version | None:
    """Return the newest version of a phase's first protocol, which its leaderboard opens with."""
    found = versions_of(session, phase.name)
    text = protocol_text(phase.protocols[0], challenge.root / CHALLENGE_YAML)
    name = parse_protocol(text).name
    return next(reversed([each for each in found if each.protocol == name] or found), None)


def kind_of(challenge: Challenge, version: Version) -> Literal["answers", "matches"]:
    """Return the kind of submission that a version scores."""
    return parse_protocol(challenge.protocol_path(version.protocol_sha256).read_bytes()).kind


def rescore(session: Session, versions: Sequence[Version], *, actor: str) -> int:
    """Queue every scored submission for the versions that it has no score of and waits for none.

    The scores it has stay as they are.

    Returns:
        Number of submissions queued.
    """
    queued = 0
    waiting = session.scalars(select(Job).where(Job.state.in_(("queued", "leased"))))
    found = {(job.submission_id, each) for job in waiting for each in job.versions}
    found |= set(session.execute(select(Score.submission_id, Score.version_id)).all())
    for phase in {each.phase for each in versions}:
        wanted = [each.id for each in versions if each.phase == phase]
        scored = select(Submission).where(
            Submission.phase == phase, Submission.state == State.SCORED
        )
        for submission in session.scalars(scored.order_by(Submission.id)):
            missing = [each for each in wanted if (submission.id, each) not in found]
            if missing:
                session.add(new_job(submission, missing, RESCORE_PRIORITY))
                queued += 1
    ids = [each.id for each in versions]
    record(session, actor, "rescored", "challenge", versions=ids, submissions=queued)
    return queued


def new_job(submission: Submission, versions: Sequence[int], priority: int) -> Job:
    """Return a job that waits."""
    return Job(
        submission_id=submission.id,
        versions=list(versions),
        priority=priority,
        created_ms=submission.created_ms,
    )


def truth_file(dataset: Dataset, private: Path, split: str) -> Path:
    """Return the file of the true answers of a split.

    Raises:
        SpecError: The private half has no such file, or is that of another dataset.
    """
    whole = dataset.with_private(private)
    name = layout.truth_name(split)
    if not whole.has(name):
        raise SpecError(
            f"the true answers of split {split} are missing",
            path=private / name,
            fix="Name a split with queries, or publish the dataset with their truth.",
        )
    return whole.local(name)


def _figures(protocol: Protocol, dataset: Dataset, split: str) -> list[dict[str, Any]]:
    """Return the figures that participants see, as `public_scores` selects them."""
    tiers = sorted({each.tier for each in dataset.sequences if each.split == split})
    of_tiers = tiers if len(tiers) > 1 else []  # the figures of a single tier are those of all
    groups = [("overall", protocol.headline), *((tier, protocol.headline[:1]) for tier in of_tiers)]
    return [
        {
            "group": group,
            "metric": name,
            "label": figure.title,
            "unit": figure.unit,
            "better": figure.better,
            "about": figure.about,
        }
        for group, names in groups
        for name in names
        for figure in [protocol.figures[name]]
    ]
