"""HTTP servers that only this machine reaches."""

from __future__ import annotations

from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from pliant.spec.errors import CallError


class LocalHandler(BaseHTTPRequestHandler):
    """Answers requests that name this machine, and prints nothing."""

    def is_local(self) -> bool:
        """Return whether a request names this machine, and refuse it otherwise.

        Another site's name may lead here (DNS rebinding).
        """
        host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
        if host in ("127.0.0.1", "localhost"):
            return True
        self.send_error(HTTPStatus.FORBIDDEN)
        return False

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: the terminal belongs to the command."""


def open_local_server(
    handler: Callable[..., BaseHTTPRequestHandler], port: int
) -> ThreadingHTTPServer:
    """Return a server on 127.0.0.1; `serve_forever` runs it.

    Args:
        handler: Answers a request.
        port: Its port, 0 for any that is free.

    Raises:
        CallError: The port is taken.
    """
    try:
        return ThreadingHTTPServer(("127.0.0.1", port), handler)
    except OSError as error:
        raise CallError(
            "the port cannot be used", where="--port", found=f"{port} ({error.strerror})"
        ) from error
