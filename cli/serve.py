"""`pliant serve`: a challenge's evaluation service, or a static site on this machine."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from pliant.cli.challenge import database_option, require_service
from pliant.cli.options import PATH, port_options
from pliant.cli.terminal import echo, show_page
from pliant.spec.errors import CallError


@click.command("serve")
@click.argument("place", metavar="CHALLENGE|SITE", type=PATH)
@partial(port_options, default="8000 for a challenge, any free port for a site")
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen on (challenge)."
)
@click.option(
    "--workers",
    type=click.IntRange(0, 256),
    default=2,
    show_default=True,
    help="Worker processes; 0 serves the pages alone (challenge).",
)
@database_option
@click.option("--base-url", default="", metavar="URL", help="Address for others (challenge).")
@click.option(
    "--trusted-proxy",
    default="",
    metavar="IP,...",
    help="Addresses or networks of reverse proxies whose X-Forwarded headers are trusted "
    "(challenge).",
)
def command(
    place: Path,
    port: int,
    no_browser: bool,
    host: str,
    database: str | None,
    **given: Any,
) -> None:
    """Serve a CHALLENGE (web, API and workers), or a static SITE to this machine.

    CHALLENGE is a folder of `pliant challenge create`. SITE is a folder that `pliant leaderboard`
    wrote, or any other folder with an index.html. Ctrl-C stops it; running jobs are finished first.
    """
    context = click.get_current_context()
    if (place / "challenge.yaml").is_file():
        require_service()
        from pliant.service.server import serve

        def listening(taken: int) -> None:
            echo(f"Serving {place} on http://{host}:{taken}; Ctrl-C stops it.")

        if context.get_parameter_source("port") is ParameterSource.DEFAULT:
            port = 8000
        given |= {"database_url": database, "listening": listening}
        serve(place, host=host, port=port, **given)
        return
    if not (place / "index.html").is_file():
        raise CallError(
            "there is neither a challenge nor a site",
            path=place,
            required="a folder with challenge.yaml or index.html",
            fix="Make one with: pliant challenge create, or pliant leaderboard REPORTS --out SITE",
        )
    unused = [
        f"--{name.replace('_', '-')}"
        for name in ("host", "workers", "base_url", "trusted_proxy")
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE
    ]
    if unused:
        raise CallError(
            "a site is served to this machine alone",
            where=", ".join(unused),
            fix="Leave the option out; to publish the site, copy its folder to a web server.",
        )
    from pliant.viewer.local_app import site_server

    show_page(site_server(place, port), str(place), no_browser=no_browser)
