"""Serves an explorer on 127.0.0.1, under an address that nobody can guess."""

from __future__ import annotations

import secrets
import socket

import uvicorn

from pliant.spec.errors import CallError
from pliant.viewer.explorer.app import Explorer


class ExplorerServer:
    """A web server that is bound to this machine alone.

    Args:
        explorer: What answers.
        port: Its port, 0 for any that is free.

    Attributes:
        address: What to open in a browser.

    Raises:
        CallError: The port is taken.
    """

    def __init__(self, explorer: Explorer, port: int = 0) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._socket.bind(("127.0.0.1", port))
            self._socket.listen()  # a browser that is opened before `run` waits
        except OSError as error:
            self._socket.close()
            raise CallError(
                "the port cannot be used", where="--port", found=f"{port} ({error.strerror})"
            ) from error
        token = secrets.token_urlsafe(16)
        self.address = f"http://127.0.0.1:{self._socket.getsockname()[1]}/{token}/"
        settings = uvicorn.Config(
            explorer.application(token),
            log_level="warning",
            access_log=False,
            lifespan="off",
            ws="none",
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(settings)

    def run(self) -> None:
        """Serve until `stop`, or until Ctrl-C in the main thread."""
        try:
            self._server.run(sockets=[self._socket])
        except KeyboardInterrupt:
            pass
        finally:
            self._socket.close()

    def stop(self) -> None:
        """End `run`, from another thread."""
        self._server.should_exit = True
