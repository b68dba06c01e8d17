"""Serves the files of a folder to this machine alone, such as a site of `pliant site`."""

from __future__ import annotations

from functools import partial
from http import HTTPStatus
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import IO, Any, Final

from pliant.spec.errors import CallError
from pliant.viewer.local_server import open_local_server

INDEX: Final = "index.html"


def make_site_server(folder: Path, port: int = 0) -> ThreadingHTTPServer:
    """Return a server of a folder's files on 127.0.0.1; `serve_forever` runs it.

    Args:
        folder: A folder with an `index.html`.
        port: Its port, 0 for any that is free.

    Raises:
        CallError: The folder has no `index.html`, or the port is taken.
    """
    if not (folder / INDEX).is_file():
        raise CallError(
            f"the folder has no {INDEX}",
            path=folder,
            required="a site",
            fix="Write one with: pliant site REPORTS --out SITE",
        )
    return open_local_server(partial(_Handler, directory=str(folder.resolve())), port)


class _Handler(SimpleHTTPRequestHandler):
    def send_head(self) -> Any:
        """Refuse a request that another site's name led here (DNS rebinding)."""
        if (self.headers.get("Host") or "").rsplit(":", 1)[0] in ("127.0.0.1", "localhost"):
            return super().send_head()
        self.send_error(HTTPStatus.FORBIDDEN)
        return None

    def list_directory(self, path: Any) -> IO[bytes] | None:  # type: ignore[override]
        """List nothing: a folder without a page is not part of the site."""
        del path
        self.send_error(HTTPStatus.NOT_FOUND)
        return None

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: the terminal belongs to the command."""
