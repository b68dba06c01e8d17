"""Showing the page of a local server until Ctrl-C."""

from __future__ import annotations

import webbrowser
from http.server import HTTPServer

from pliant.cli.terminal import echo


def show_page(server: HTTPServer, subject: str, *, no_browser: bool) -> None:
    """Print a server's address, open it in the browser, and serve until Ctrl-C.

    Args:
        server: A server on 127.0.0.1; it is closed at the end.
        subject: What the page shows.
        no_browser: Leave the browser alone.
    """
    address = f"http://127.0.0.1:{server.server_address[1]}/"
    echo(f"{subject} at {address} (Ctrl-C ends)")
    if not no_browser:
        webbrowser.open(address)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        pass
    finally:
        server.server_close()
