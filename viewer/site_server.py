"""Serves the files of a folder to this machine alone, such as a site of `pliant site`."""

from __future__ import annotations

from functools import partial
from http import HTTPStatus
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import IO, Any, Final

from pliant.spec.errors import CallError
from pliant.viewer.local_server import LocalHandler, open_local_server

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


class _Handler(LocalHandler, SimpleHTTPRequestHandler):
    def send_head(self) -> Any:
        """Open a file for a request that names this machine."""
        return super().send_head() if self.is_local() else None

    def list_directory(self, path: Any) -> IO[bytes] | None:  # type: ignore[override]
        """List nothing: a folder without a page is not part of the site."""
        del path
        self.send_error(HTTPStatus.NOT_FOUND)
        return None
