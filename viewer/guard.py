"""Keeps other web pages out: requests must name this machine, carry the token, and be its own.

A page of another site can make a browser ask 127.0.0.1, also under a name of its own that points
here (DNS rebinding). It neither knows the token nor can it hide its `Host` or `Origin`.
"""

from __future__ import annotations

import secrets
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class Guard:
    """Answers 403 to what does not come from the explorer's own page.

    Args:
        app: The application.
        token: The first part of every path.
    """

    def __init__(self, app: ASGIApp, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it; see the ASGI specification."""
        if scope["type"] != "http":
            return

        async def send_with_policy(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["Content-Security-Policy"] = _POLICY
                headers["Referrer-Policy"] = "no-referrer"
                headers["X-Content-Type-Options"] = "nosniff"
                headers["Cross-Origin-Resource-Policy"] = "same-origin"
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        reason = self._refusal(scope)
        if reason:
            refused = PlainTextResponse(f"Refused: {reason}\n", status_code=403)
            await refused(scope, receive, send_with_policy)
        else:
            await self._app(scope, receive, send_with_policy)

    def _refusal(self, scope: Scope) -> str:
        """Return why a request is refused, or an empty text."""
        headers = Headers(scope=scope)
        port = scope["server"][1]
        own = {f"127.0.0.1:{port}", f"localhost:{port}"}
        if headers.get("host", "") not in own:
            return "another host"
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{host}" for host in own}:
            return "another origin"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return "another site"
        given = scope["path"].split("/")[1]
        if not secrets.compare_digest(given.encode(), self._token.encode()):
            return "the address lacks the token that pliant explore printed"
        return ""
