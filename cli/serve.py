"""`pliant serve`: a static site, served to this machine."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import click

from pliant.cli.options import PATH, port_options
from pliant.cli.terminal import echo


@click.command("serve")
@click.argument("places", metavar="SITE", nargs=-1, required=True, type=PATH)
@click.option("--out", hidden=True, type=PATH)
@port_options
def command(places: tuple[Path, ...], out: Path | None, port: int, no_browser: bool) -> None:
    """Serve SITE, a folder that `pliant site` wrote, on this machine only; Ctrl-C stops it.

    Any folder with an index.html can be served, such as the documentation or a demo's report.
    """
    from pliant.spec.errors import CallError
    from pliant.viewer.site_server import make_site_server

    if out is not None or len(places) != 1:
        raise CallError(
            "pliant serve shows one site and writes none",
            fix="Write a site with: pliant site REPORTS --out SITE",
        )
    server = make_site_server(places[0], port)
    address = f"http://127.0.0.1:{server.server_address[1]}/"
    echo(f"{places[0]} at {address} (Ctrl-C ends)")
    if not no_browser:
        webbrowser.open(address)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        pass
    finally:
        server.server_close()
