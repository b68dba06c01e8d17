"""Showing a local page until Ctrl-C."""

from __future__ import annotations

import webbrowser
from typing import TYPE_CHECKING

from pliant.cli.terminal import echo

if TYPE_CHECKING:
    from pliant.viewer.local_app import LocalServer


def show_page(server: LocalServer, subject: str, *, no_browser: bool) -> None:
    """Print a server's address, open it in the browser, and serve until Ctrl-C.

    Args:
        server: The server; it is closed at the end.
        subject: What the page shows.
        no_browser: Do not open a browser.
    """
    echo(f"{subject}\n{server.address} (Ctrl-C ends)")
    if not no_browser:
        webbrowser.open(server.address)
    server.run()
