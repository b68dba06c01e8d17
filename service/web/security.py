"""Authentication of requests, and the security headers of pages."""

from __future__ import annotations

import asyncio
import hmac
from typing import Annotated, Final
from urllib.parse import urlsplit

from fastapi import Depends, Form, Request
from fastapi.responses import JSONResponse
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pliant.service.submissions import NotAcceptedError
from pliant.service.teams import Identity, identify, identify_session
from pliant.service.web.state import Site

COOKIE: Final = "pliant_session"
SMALL_BODY: Final = 64 * 1024
_STOPPING: Final = {
    "code": "SERVICE_STOPPING",
    "message": "the service is stopping. Send the file again: it is never charged twice.",
}
_BEARER: Final = HTTPBearer(auto_error=False, description="The team's token.")


def site_of(request: Request) -> Site:
    """Return what all requests share."""
    site: Site = request.app.state.site
    return site


TheSite = Annotated[Site, Depends(site_of)]


def token_identity(request: Request, token: str) -> Identity:
    """Return whose token it is.

    Raises:
        NotAcceptedError: Nobody's, or too many wrong ones from this address.
    """
    site = site_of(request)
    client = request.client.host if request.client else "unknown"
    site.throttle.check(client)
    with site.database.read() as session:
        who = identify(session, token)
    if who is None:
        site.throttle.add(client)
        raise NotAcceptedError(
            "TOKEN_INVALID", 401, "the token is not valid", fix="Ask the host for a new one."
        )
    return who


def optional_identity(
    request: Request,
    bearer: Annotated[HTTPAuthorizationCredentials | None, Depends(_BEARER)] = None,
) -> Identity | None:
    """Return the identity of a request, from its token or cookie; None for a visitor.

    It is stored as `request.state.who` for error pages.
    """
    cookie, who = request.cookies.get(COOKIE), None
    if bearer is not None:
        who = token_identity(request, bearer.credentials)
    elif cookie:
        with site_of(request).database.read() as session:
            who = identify_session(session, cookie)
    request.state.who = who
    return who


Visitor = Annotated[Identity | None, Depends(optional_identity)]


def signed_in(who: Visitor) -> Identity:
    """Return who makes a request; refuse visitors."""
    if who is None:
        raise NotAcceptedError(
            "TOKEN_MISSING",
            401,
            "a token is needed",
            fix="Sign in, or send the header: Authorization: Bearer TOKEN",
        )
    return who


Member = Annotated[Identity, Depends(signed_in)]


def by_token(who: Member) -> Identity:
    """Return who makes a request; refuse cookies, which other sites' forms bring along."""
    if who.csrf:
        raise NotAcceptedError(
            "TOKEN_MISSING", 401, "the API takes tokens only", fix="Send Authorization: Bearer."
        )
    return who


def host_only(who: Member) -> Identity:
    """Return who makes a request; to all but the host the page does not exist."""
    if not who.is_host:
        raise NotAcceptedError("NOT_FOUND", 404, "no such page")
    return who


def check_form(request: Request, who: Identity, csrf: str) -> None:
    """Refuse a form that another site sent."""
    check_origin(request)
    if not who.csrf or not hmac.compare_digest(csrf.encode(), who.csrf.encode()):
        raise NotAcceptedError(
            "FORM_EXPIRED", 403, "the form is not valid any more", fix="Reload the page."
        )


def check_origin(request: Request) -> None:
    """Refuse a request that another site's page makes."""
    origin = request.headers.get("origin")
    # A reverse proxy may pass another name on than the one that browsers see.
    own = (request.headers.get("host"), urlsplit(site_of(request).base_url).netloc)
    if origin and urlsplit(origin).netloc not in own:
        raise NotAcceptedError("FOREIGN_ORIGIN", 403, "the form is of another site")


def _host_form(
    request: Request, who: Annotated[Identity, Depends(host_only)], csrf: Annotated[str, Form()]
) -> Identity:
    check_form(request, who, csrf)
    return who


HostForm = Annotated[Identity, Depends(_host_form)]
Host = Annotated[Identity, Depends(host_only)]


class Protection:
    """Adds security headers, and refuses bodies that are larger than their route allows.

    Args:
        app: The application.
        site: What it serves.
        upload_paths: Paths that take a submission.
    """

    def __init__(self, app: ASGIApp, site: Site, upload_paths: frozenset[str]) -> None:
        self._app, self._site, self._uploads = app, site, upload_paths

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        most = SMALL_BODY
        if scope["path"] in self._uploads:
            most += self._site.challenge.settings.max_file_bytes
        received, started = 0, False

        async def limited() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > most:
                raise too_large(self._site.challenge.settings.max_file_mb)
            return message

        async def protected(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                headers = MutableHeaders(scope=message)
                for name, value in self._site.headers.items():
                    headers.setdefault(name, value)
            await send(message)

        try:
            await self._app(scope, limited, protected)
        except asyncio.CancelledError:  # the server stops and waits no longer for this request
            if started:
                raise
            await JSONResponse(_STOPPING, 503, {"Retry-After": "5"})(scope, receive, protected)


def too_large(max_file_mb: float) -> NotAcceptedError:
    """Return the refusal of a body that is too large."""
    return NotAcceptedError(
        "FILE_TOO_LARGE", 413, "the file is too large", required=f"at most {max_file_mb:g} MB"
    )
