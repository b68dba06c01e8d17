"""HTTP servers that only this machine reaches."""

from __future__ import annotations

from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from pliant.spec.errors import CallError


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
