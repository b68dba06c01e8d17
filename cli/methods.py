"""`pliant methods`: what `pliant predict` and `pliant match` can run."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import click

from pliant.cli.options import json_option
from pliant.cli.terminal import echo, echo_json


@click.command()
@json_option
def command(as_json: bool) -> None:
    """List the installed methods, and the optional dependencies that some of them need.

    Packages offer methods in the entry-point group `pliant.matchers`.
    """
    rows = list(_methods())
    if as_json:
        echo_json({"methods": rows})
        return
    width = max(len(row["name"]) for row in rows)
    for row in rows:
        missing = f" Missing: {row['missing']}" if row["missing"] else ""
        echo(f"{row['name']:{width}}  {row['about']}{missing}")


def _methods() -> Iterator[dict[str, Any]]:
    """Yield name, origin, first line of documentation, and what is missing, of each method."""
    from pliant.baselines import METHODS
    from pliant.baselines.modern import MODERN
    from pliant.baselines.plugins import plugged_in
    from pliant.models.shipped import shipped_names
    from pliant.spec.errors import MissingExtraError

    for name, make in METHODS.items():
        missing = None
        try:
            make()
        except MissingExtraError as error:
            missing = (error.fix or "").removeprefix("Install them with: ")
        yield _row(name, "built in", inspect.getdoc(make) or "", missing)
    for name, network in MODERN.items():
        found = find_spec(network.library) is not None
        about = (inspect.getdoc(network) or "").partition("\n")[0] + " Takes --set weights=..."
        yield _row(name, "network", about, None if found else f"library {network.library}")
    for name in shipped_names():
        yield _row(name, "shipped model", "Trained model; its card is in the package.", None)
    for name, entry in plugged_in().items():
        package = f" of {entry.dist.name} {entry.dist.version}" if entry.dist else ""
        yield _row(name, "plug-in", f"Plug-in {entry.value}{package}", None)


def _row(name: str, origin: str, about: str, missing: str | None) -> dict[str, Any]:
    first = about.partition("\n")[0].removeprefix("Return the ")
    return {
        "name": name,
        "origin": origin,
        "about": first[:1].upper() + first[1:],
        "missing": missing,
    }
