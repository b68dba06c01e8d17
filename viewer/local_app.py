"""The local web application: pages of the viewer, and plain sites, for this machine alone.

`explore`, `annotate` and the preview of a site are Starlette routes behind one guard, run by one
server.
"""

from __future__ import annotations

import os
import secrets
import socket
from collections.abc import Callable, Sequence
from pathlib import Path, PurePath
from typing import Final

import uvicorn
from starlette.applications import Starlette
from starlette.responses import FileResponse, RedirectResponse
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from pliant.spec.errors import CallError
from pliant.viewer.guard import Guard

INDEX: Final = "index.html"


class OwnFiles(StaticFiles):
    """The files of a folder, without links and without files whose names begin with a dot."""

    def lookup_path(self, path: str) -> tuple[str, os.stat_result | None]:
        """Return a file's path and status, or None for one that is not served."""
        assert self.directory is not None
        place = Path(self.directory)
        for part in PurePath(path).parts:
            place /= part
            if part.startswith(".") or place.is_symlink():
                return "", None
        return super().lookup_path(path)


def page_application(folder: Path, routes: Sequence[BaseRoute], token: str) -> ASGIApp:
    """Return the application of a page, everything below `/TOKEN/`.

    Args:
        folder: The page's own files; `index.html` is the page, the others are below `static/`.
        routes: What else it asks for.
        token: What nobody else knows.
    """
    pages = [
        Route("/", lambda request: FileResponse(folder / INDEX)),
        *routes,
        Mount("/static", OwnFiles(directory=folder)),
    ]
    slash = Route(f"/{token}", lambda request: RedirectResponse(f"/{token}/"))
    return Guard(Starlette(routes=[slash, Mount(f"/{token}", routes=pages)]), token)


def site_application(folder: Path) -> ASGIApp:
    """Return the application of a plain site, such as `pliant leaderboard` writes.

    Args:
        folder: A folder with an `index.html`.
    """
    files = OwnFiles(directory=folder.resolve(), html=True)
    return Guard(Starlette(routes=[Mount("/", files)]), policy="")


class LocalServer:
    """A web server that is bound to this machine alone.

    Args:
        application: Returns the application for a token.
        port: Its port, 0 for any that is free.
        token: Whether the address has a token that nobody can guess.

    Attributes:
        address: What to open in a browser.

    Raises:
        CallError: The port is taken.
    """

    def __init__(
        self, application: Callable[[str], ASGIApp], port: int = 0, *, token: bool = True
    ) -> None:
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
        secret = secrets.token_urlsafe(16) if token else ""
        root = f"http://127.0.0.1:{self._socket.getsockname()[1]}/"
        self.address = f"{root}{secret}/" if token else root
        settings = uvicorn.Config(
            application(secret),
            log_config=None,  # a new one closes the handlers of the program
            log_level="critical",
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


def site_server(folder: Path, port: int = 0) -> LocalServer:
    """Return a server of a plain site; see `site_application` and `LocalServer`."""
    application = site_application(folder)
    return LocalServer(lambda token: application, port, token=False)
