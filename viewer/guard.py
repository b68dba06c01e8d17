"""Lets only this machine's own pages reach a local application.

A page of another site can make a browser ask 127.0.0.1, also under a name of its own that points
here (DNS rebinding). It neither knows the token nor can it hide its `Host` or `Origin`.
"""

from __future__ import annotations

import logging
import secrets
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

STRICT_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy of pages that load nothing but their own files."""

_LOG: Final = logging.getLogger(__name__)
_METHODS: Final = ("GET", "HEAD", "POST")


class Guard:
    """Refuses what does not come from this machine's own page.

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
            await self._app(scope, receive, send_with_headers)
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
