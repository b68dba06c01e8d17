"""The host's page: teams, tokens, credits, withdrawals, rescoring, the audit log."""

from __future__ import annotations

import math
from typing import Annotated, Any

from fastapi import APIRouter, Form
from fastapi.responses import HTMLResponse, RedirectResponse
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from pliant.evaluator import PROTOCOL_NAMES
from pliant.evaluator.protocols.protocol import protocol_text
from pliant.evaluator.scores import BITS_PER_FIGURE
from pliant.service.audit import log_time
from pliant.service.ledger import Attempts, attempts, credit
from pliant.service.models import AuditEntry, Job, Score, Submission, Team, Token, Version
from pliant.service.submissions import withdraw
from pliant.service.teams import invite, new_token, revoke_token
from pliant.service.versions import add_version, rescore, versions_of
from pliant.service.web.api import MaybeNumber, phase_of
from pliant.service.web.pages import page
from pliant.service.web.security import Host, HostForm, TheSite
from pliant.service.web.state import Site
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError

router = APIRouter(prefix="/admin", include_in_schema=False, default_response_class=HTMLResponse)

FormNumber = Annotated[int, Form(ge=1, lt=2**53)]

_ENTRIES = 200


def bits_per_submission(version: Version) -> float:
    """Return the most bits about the answers that the figures of one submission can carry."""
    return len(version.figures) * BITS_PER_FIGURE


def _values(session: Session, site: Site) -> dict[str, Any]:
    settings = site.challenge.settings
    time_ms = log_time(session)
    teams = session.scalars(select(Team).order_by(Team.id)).all()
    tokens: dict[int, list[Token]] = {}
    for token in session.scalars(select(Token).order_by(Token.created_ms)):
        tokens.setdefault(token.team_id, []).append(token)
    bits: dict[int, float] = {}
    versions = {each.id: each for each in session.scalars(select(Version))}
    scored = (
        select(Submission.team_id, Score.version_id, func.count())
        .join(Score, Score.submission_id == Submission.id)
        .group_by(Submission.team_id, Score.version_id)
    )
    for team_id, version_id, count in session.execute(scored):
        given = count * bits_per_submission(versions[version_id])
        bits[team_id] = bits.get(team_id, 0) + given
    left: dict[int, list[tuple[str, Attempts]]] = {
        team.id: [
            (phase.name, attempts(session, team.id, phase, time_ms)) for phase in settings.phases
        ]
        for team in teams
    }
    width, height = Dataset.open(site.challenge.public).size
    jobs = select(Job.state, func.count()).group_by(Job.state)
    failed = session.scalars(
        select(Job).where(Job.error.is_not(None)).order_by(Job.id.desc()).limit(20)
    )
    return {
        "teams": teams,
        "tokens": tokens,
        "bits": bits,
        "left": left,
        "bits_per_answer": math.log2(width * height),
        "versions": [
            (each, bits_per_submission(each))
            for phase in settings.phases
            for each in versions_of(session, phase.name)
        ],
        "jobs": {state: count for state, count in session.execute(jobs)},
        "failed": failed.all(),
        "protocols": PROTOCOL_NAMES,
        "truths": sorted({each.truth for each in versions.values()}),
    }


def _admin_page(site: Site, who: Host, **values: Any) -> HTMLResponse:
    shown = {"token": None, "team_name": None, "note": None, **values}
    with site.database.read() as session:
        return page(site, "admin.html.j2", who, **_values(session, site), **shown)


@router.get("")
def admin(site: TheSite, who: Host) -> HTMLResponse:
    """Show the page."""
    return _admin_page(site, who)


@router.get("/audit")
def audit_log(site: TheSite, who: Host, before: MaybeNumber = None) -> HTMLResponse:
    """Show the log, the last entries first."""
    query = select(AuditEntry).order_by(AuditEntry.seq.desc()).limit(_ENTRIES)
    with site.database.read() as session:
        if before is not None:
            query = query.where(AuditEntry.seq < before)
        return page(site, "audit.html.j2", who, entries=session.scalars(query).all())


@router.post("/invite")
def post_invite(
    site: TheSite, who: HostForm, name: Annotated[str, Form(max_length=200)]
) -> HTMLResponse:
    """Add a team, and show its token this once."""
    with site.database.write() as session:
        team, token = invite(session, name, actor=who.actor)
        name = team.name
    return _admin_page(site, who, token=token, team_name=name)


@router.post("/token")
def post_token(site: TheSite, who: HostForm, team: FormNumber) -> HTMLResponse:
    """Give a team another token."""
    with site.database.write() as session:
        found = session.get(Team, team)
        if found is None:
            raise CallError("no such team", found=team)
        token = new_token(session, team, actor=who.actor)
        name = found.name
    return _admin_page(site, who, token=token, team_name=name)


@router.post("/revoke")
def post_revoke(
    site: TheSite, who: HostForm, token_id: Annotated[str, Form(max_length=40)]
) -> RedirectResponse:
    """End a token."""
    with site.database.write() as session:
        revoke_token(session, token_id, actor=who.actor)
    return RedirectResponse("/admin#teams", 303)


@router.post("/credit")
def post_credit(
    site: TheSite,
    who: HostForm,
    team: FormNumber,
    phase: Annotated[str, Form(max_length=60)],
    amount: Annotated[int, Form(ge=1, le=10_000)],
) -> RedirectResponse:
    """Give a team more attempts."""
    rules = phase_of(site, phase)
    with site.database.write() as session:
        if session.get(Team, team) is None:
            raise CallError("no such team", found=team)
        credit(session, team, rules, amount, log_time(session), actor=who.actor)
    return RedirectResponse("/admin#teams", 303)


@router.post("/withdraw")
def post_withdraw(site: TheSite, who: HostForm, submission: FormNumber) -> RedirectResponse:
    """Take a submission off the leaderboard."""
    with site.database.write() as session:
        withdraw(session, submission, actor=who.actor)
    return RedirectResponse(f"/submissions/{submission}", 303)


@router.post("/rescore")
def post_rescore(
    site: TheSite,
    who: HostForm,
    phase: Annotated[str, Form(max_length=60)],
    protocol: Annotated[str, Form(max_length=60)],
    reason: Annotated[str, Form(max_length=300)],
) -> HTMLResponse:
    """Queue all scored submissions of a phase for a protocol, next to the scores they have.

    A new truth is added with `pliant challenge rescore`: the web process cannot read one.
    """
    rules = phase_of(site, phase)
    if protocol not in PROTOCOL_NAMES:
        raise CallError("no such protocol", found=protocol, required=", ".join(PROTOCOL_NAMES))
    with site.database.write() as session:
        version = add_version(
            session, site.challenge, rules, protocol_text(protocol), None, reason, actor=who.actor
        )
        count = rescore(session, [version], actor=who.actor)
    waiting = "1 submission waits" if count == 1 else f"{count} submissions wait"
    return _admin_page(site, who, note=f"{waiting} to be scored by {protocol}.")
