"""The local web application: pages of the viewer, and plain sites, for this machine alone.

`explore`, `annotate` and the preview of a site are Starlette routes behind one guard, run by one
server.
"""

from __future__ import annotations

import logging
import os
import secrets
import socket
from collections.abc import Callable, Sequence
from pathlib import Path, PurePath
from typing import Final

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pliant.spec.errors import CallError

INDEX: Final = "index.html"
STRICT_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy of pages that load nothing but their own files."""

_LOG: Final = logging.getLogger(__name__)
_METHODS: Final = ("GET", "HEAD", "POST")


class Guard:
    """Refuses what does not come from this machine's own page.

    A page of another site can make a browser ask 127.0.0.1, also under a name of its own that
    points here (DNS rebinding). It neither knows the token nor can it hide its `Host` or `Origin`.

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
