"""`pliant migrate`: bring a dataset to the current specification version."""

from __future__ import annotations

import json
from pathlib import Path

import click

from pliant.cli.terminal import echo


@click.command()
@click.argument("data", metavar="DIR", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(data: Path, as_json: bool) -> None:
    """Bring a dataset to the current specification version, in place.

    Rewrites its JSON documents, dataset.json last; images and tables stay. Running it again
    after an interruption goes on; on a current dataset it does nothing.
    """
    from pliant.spec.errors import CallError
    from pliant.spec.migrate import migrate

    if not data.is_dir():
        raise CallError("there is no such folder", path=data, fix="Name a dataset's folder.")
    result = migrate(data)
    if as_json:
        echo(json.dumps(vars(result), indent=1))
    elif not result.files:
        echo(f"{data}: already of version {result.found}; nothing to do.")
    else:
        echo(
            f"{data}: from {result.found} to {result.reached}, {len(result.files)} files "
            f"rewritten. Check it with: pliant validate {data}"
        )
