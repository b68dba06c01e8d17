"""Teams, their tokens, and the identity that belongs to a token."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import unicodedata
from dataclasses import dataclass

from sqlalchemy import select
from sqlalchemy.orm import Session

from pliant.service.audit import record
from pliant.service.database import now_ms
from pliant.service.models import Team, Token, WebSession
from pliant.spec.errors import CallError
from pliant.spec.text import name_fault

SESSION_MS = 12 * 3600 * 1000
_LONGEST_NAME = 80


@dataclass(frozen=True)
class Identity:
    """Who makes a request.

    Attributes:
        team_id: The team.
        name: Its name.
        is_host: Whether it is the host.
        token_id: Public part of the token.
        csrf: Text that a form must contain; empty for requests with a token.
    """

    team_id: int
    name: str
    is_host: bool
    token_id: str
    csrf: str = ""

    @property
    def actor(self) -> str:
        """Who it is in the audit log."""
        return "host" if self.is_host else f"team {self.team_id}"


def invite(session: Session, name: str, *, actor: str, is_host: bool = False) -> tuple[Team, str]:
    """Add a team and return it with its token, which is shown only once.

    Raises:
        CallError: The name is taken, empty, too long, or has characters that cannot be shown.
    """
    name = unicodedata.normalize("NFC", " ".join(name.split()))
    if len(name) > _LONGEST_NAME or name_fault(name) is not None:
        raise CallError(
            "the team's name cannot be used",
            found=repr(name)[:100],
            required=f"1 to {_LONGEST_NAME} printable characters",
        )
    if _named(session, name) is not None:
        raise CallError(
            "a team of this name exists",
            found=name,
            fix="Choose another name, or give the team a new token on the admin page.",
        )
    team = Team(name=name, is_host=is_host, created_ms=now_ms())
    session.add(team)
    session.flush()
    record(session, actor, "invited", f"team {team.id}", name=name, is_host=is_host)
    return team, new_token(session, team.id, actor=actor)


def new_token(session: Session, team_id: int, *, actor: str) -> str:
    """Make another token for a team and return it; only its hash is stored."""
    token_id, secret = secrets.token_hex(6), secrets.token_urlsafe(32)
    session.add(
        Token(
            id=token_id,
            team_id=team_id,
            secret_sha256=_sha256(secret),
            created_ms=now_ms(),
            revoked_ms=None,
        )
    )
    record(session, actor, "token made", f"team {team_id}", token_id=token_id)
    return f"pliant_{token_id}_{secret}"


def revoke_token(session: Session, token_id: str, *, actor: str) -> None:
    """End a token and every browser session that began with it."""
    token = session.get(Token, token_id)
    if token is None or token.revoked_ms is not None:
        raise CallError("no such token", found=token_id[:40])
    token.revoked_ms = now_ms()
    for each in session.scalars(select(WebSession).where(WebSession.token_id == token_id)):
        session.delete(each)
    record(session, actor, "token revoked", f"team {token.team_id}", token_id=token_id)


def team_of(session: Session, name: str) -> Team:
    """Return a team by its name.

    Raises:
        CallError: There is none.
    """
    team = _named(session, name)
    if team is None:
        raise CallError("no such team", found=repr(name)[:100], fix="See the admin page.")
    return team


def _named(session: Session, name: str) -> Team | None:
    """Return the team whose name reads the same. SQLite's `lower` knows ASCII letters alone."""
    wanted = _as_read(name)
    return next(
        (each for each in session.scalars(select(Team)) if _as_read(each.name) == wanted), None
    )


def _as_read(name: str) -> str:
    return unicodedata.normalize("NFKC", " ".join(name.split())).casefold()


def identify(session: Session, token: str) -> Identity | None:
    """Return whose token it is, None if it is nobody's; takes equally long for any secret."""
    prefix, _, rest = token.partition("_")
    token_id, _, secret = rest.partition("_")
    found = session.get(Token, token_id) if prefix == "pliant" else None
    expected = found.secret_sha256 if found is not None else "0" * 64
    matches = hmac.compare_digest(_sha256(secret), expected)
    if found is None or not matches or found.revoked_ms is not None:
        return None
    return _identity(session, found)


def begin_session(session: Session, identity: Identity) -> str:
    """Sign a browser in and return its cookie; sessions that have ended are removed."""
    for old in session.scalars(select(WebSession).where(WebSession.expires_ms < now_ms())):
        session.delete(old)
    cookie = secrets.token_urlsafe(32)
    session.add(
        WebSession(
            cookie_sha256=_sha256(cookie),
            token_id=identity.token_id,
            csrf=secrets.token_urlsafe(24),
            expires_ms=now_ms() + SESSION_MS,
        )
    )
    return cookie


def identify_session(session: Session, cookie: str) -> Identity | None:
    """Return who a browser's cookie belongs to, None if nobody's."""
    found = session.get(WebSession, _sha256(cookie))
    if found is None or found.expires_ms < now_ms():
        return None
    token = session.get(Token, found.token_id)
    if token is None or token.revoked_ms is not None:
        return None
    return _identity(session, token, found.csrf)


def end_session(session: Session, cookie: str) -> None:
    """Sign a browser out."""
    found = session.get(WebSession, _sha256(cookie))
    if found is not None:
        session.delete(found)


def _identity(session: Session, token: Token, csrf: str = "") -> Identity:
    team = session.get_one(Team, token.team_id)
    return Identity(team.id, team.name, team.is_host, token.id, csrf)


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
