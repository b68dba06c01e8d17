"""`pliant migrate`: bring a dataset to the current specification version."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.options import PATH, json_option
from pliant.cli.terminal import echo_result


@click.command()
@click.argument("data", metavar="DIR", type=PATH)
@json_option
def command(data: Path, as_json: bool) -> None:
    """Bring a dataset to the current specification version, in place.

    Rewrites the JSON documents, dataset.json last; images and tables do not change. Run it again
    after an interruption. A current dataset is left as it is.
    """
    from pliant.spec.errors import CallError
    from pliant.spec.migrate import migrate

    if not data.is_dir():
        raise CallError("folder not found", path=data, fix="Name a dataset's folder.")
    result = migrate(data)
    text = f"{data}: already of version {result.found}; nothing to do."
    if result.files:
        text = (
            f"{data}: from {result.found} to {result.reached}, {len(result.files)} files "
            f"rewritten. Check it with: pliant validate {data}"
        )
    echo_result(vars(result), text, as_json=as_json)
