"""Lets only this machine's own pages reach a local application, and bounds what they send.

A page of another site can make a browser ask 127.0.0.1, also under a name of its own that points
here (DNS rebinding). It neither knows the token nor can it hide its `Host` or `Origin`.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

STRICT_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy of pages that load nothing but their own files."""

_MAX_BODY_BYTES: Final = 4 * 2**20
_BODY_S: Final = 20.0
_LOG: Final = logging.getLogger(__name__)
_METHODS: Final = ("GET", "HEAD", "POST")


class Guard:
    """Refuses what does not come from this machine's own page, and what is too large or too slow.

    Args:
        app: The application.
        token: The first part of every path; empty for an application without one.
        policy: Its content security policy; empty for none.
    """

    def __init__(self, app: ASGIApp, token: str = "", policy: str = STRICT_POLICY) -> None:
        self._app, self._token, self._policy = app, token, policy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it; see the ASGI specification."""
        if scope["type"] != "http":
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                if self._policy:
                    headers["Content-Security-Policy"] = self._policy
                headers["Referrer-Policy"] = "no-referrer"
                headers["X-Content-Type-Options"] = "nosniff"
                headers["Cross-Origin-Resource-Policy"] = "same-origin"
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        status, reason = self._refusal(scope)
        if reason:
            refused = PlainTextResponse(f"Refused: {reason}\n", status)
            await refused(scope, receive, send_with_headers)
            return
        try:
            await self._app(scope, _bounded(receive), send_with_headers)
        except Exception:  # Starlette has answered with status 500
            _LOG.exception("%s %s failed", scope["method"], scope["path"])

    def _refusal(self, scope: Scope) -> tuple[int, str]:
        """Return the status and the reason why a request is refused; an empty text if it is not."""
        if scope["method"] not in _METHODS:
            return 405, f"only {', '.join(_METHODS)} are answered"
        if not scope["path"].startswith("/") or not scope["path"].isprintable():
            return 400, "this is not a path"
        headers = Headers(scope=scope)
        port = scope["server"][1]
        own = {f"127.0.0.1:{port}", f"localhost:{port}"}
        if headers.get("host", "") not in own:
            return 403, "another host"
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{host}" for host in own}:
            return 403, "another origin"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return 403, "another site"
        given = scope["path"].split("/")[1]
        if self._token and not secrets.compare_digest(given.encode(), self._token.encode()):
            return 403, "the address lacks the token that the command printed"
        return 200, ""


def _bounded(receive: Receive) -> Receive:
    """Return a `receive` that refuses a body which is too large or too slow."""
    left, complete = _MAX_BODY_BYTES, False
    end = asyncio.get_running_loop().time() + _BODY_S

    async def bounded() -> Message:
        nonlocal left, complete
        try:
            async with asyncio.timeout_at(None if complete else end):
                message = await receive()
        except TimeoutError:
            raise HTTPException(408, f"not complete after {_BODY_S:g} s") from None
        left -= len(message.get("body", b""))
        complete = not message.get("more_body")
        if left < 0:
            raise HTTPException(413, f"more than {_MAX_BODY_BYTES:,} bytes")
        return message

    return bounded
