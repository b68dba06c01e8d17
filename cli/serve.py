"""`pliant serve`: a static site, served to this machine."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.local_page import show_page
from pliant.cli.options import PATH, port_options


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
    show_page(server, str(places[0]), no_browser=no_browser)
