"""`pliant methods`: what `pliant predict` and `pliant match` can run."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any

import click

from pliant.cli.options import json_option
from pliant.cli.terminal import echo, echo_json
from pliant.spec.errors import MissingExtraError, install_command
from pliant.spec.extras import extra_of, is_installed


@click.command()
@json_option
def command(as_json: bool) -> None:
    """List the available methods, and the commands that install missing requirements.

    Other packages can register methods in the entry-point group `pliant.matchers`.
    """
    rows = list(_methods())
    if as_json:
        echo_json({"methods": rows})
        return
    width = max(len(row["name"]) for row in rows)
    for row in rows:
        echo(f"{row['name']:{width}}  {row['about']}")
        if row["missing"]:
            echo(f"{'':{width}}  Missing here; install it with: {row['missing']}")


def _methods() -> Iterator[dict[str, Any]]:
    """Yield name, origin, first line of documentation, and what is missing, of each method."""
    from pliant.baselines import METHODS
    from pliant.baselines.adapters.vismatch import PREFIX, open_vismatch
    from pliant.baselines.fused_tracker import PREFIX as FUSED
    from pliant.baselines.fused_tracker import FusedTracker
    from pliant.baselines.plugins import plugged_in
    from pliant.models import CARD
    from pliant.models.shipped import FOLDER, shipped_names
    from pliant.models.timecycle import CARRIED

    train = None
    if not (is_installed("torch") and is_installed("safetensors")):
        train = install_command("train")
    for name, make in METHODS.items():
        yield _row(name, "built in", inspect.getdoc(make) or "", _missing(make))
    for name in shipped_names():
        first = (FOLDER / name / CARD).read_text("utf-8").split("\n\n")[1].partition(". ")[0]
        yield _row(name, "shipped model", f"{first.replace('`', '')}.", train)
    about, lacking = inspect.getdoc(FusedTracker) or "", not is_installed("cv2")
    missing = install_command("classical") if lacking else None
    yield _row(f"{FUSED}METHOD", "built in", about, missing)
    about = "Points carried by the descriptors of Dense Object Nets."
    yield _row(f"{CARRIED}MODEL", "built in", about, missing or train)
    found = is_installed("vismatch")
    about = inspect.getdoc(open_vismatch) or ""
    yield _row(f"{PREFIX}NAME", "package", about, None if found else "pip install vismatch")
    for name, entry in plugged_in().items():
        package = f" of {entry.dist.name} {entry.dist.version}" if entry.dist else ""
        yield _row(name, "plug-in", f"Plug-in {entry.value}{package}", None)


def _missing(make: Callable[[], object]) -> str | None:
    """Return the command that installs what a method lacks, or None if it can be made."""
    try:
        make()
    except MissingExtraError as error:
        return error.command
    except ModuleNotFoundError as error:
        return install_command(extra_of(error.name or "") or str(error.name))
    return None


def _row(name: str, origin: str, about: str, missing: str | None) -> dict[str, Any]:
    first = about.partition("\n")[0].removeprefix("Return ").removeprefix("the ")
    return {
        "name": name,
        "origin": origin,
        "about": first[:1].upper() + first[1:],
        "missing": missing,
    }
