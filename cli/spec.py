"""`pliant spec`: print or write the specification's schemas."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pliant.cli.terminal import echo


@click.command()
@click.argument("name", required=False)
@click.option("--out", type=click.Path(path_type=Path), help="Write SPEC.md and all schemas there.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(name: str | None, out: Path | None, as_json: bool) -> None:
    """Print or write the specification's schemas.

    Without NAME, lists them. NAME is one of the JSON Schemas (dataset, sequence, cameras,
    footer-TABLE), a table (points, correspondences …), `codes` or `text`.
    """
    import json

    from pliant.spec.conventions import SPEC_VERSION
    from pliant.spec.errors import CallError
    from pliant.spec.export import (
        JSON_SCHEMAS,
        describe_table,
        specification_files,
        write_specification,
    )
    from pliant.spec.io.jsonfiles import load_schema
    from pliant.spec.tables import TABLES
    from pliant.spec.validation.issue_codes import ISSUE_CODES

    if out is not None:
        written = write_specification(out)
        if as_json:
            echo(json.dumps({"written": [str(path) for path in written]}, indent=1))
        else:
            echo(f"Wrote {len(written)} files to {out}.")
        return
    if name is None:
        listing: dict[str, Any] = {
            "spec_version": SPEC_VERSION,
            "schemas": list(JSON_SCHEMAS),
            "tables": list(TABLES),
            "other": ["codes", "text"],
        }
        if as_json:
            echo(json.dumps(listing, indent=1))
        else:
            echo(f"Specification {SPEC_VERSION}")
            for key in ("schemas", "tables", "other"):
                echo(f"{key}: {', '.join(listing[key])}")
        return
    if name == "text":
        text = specification_files()["SPEC.md"].decode()
        echo(json.dumps({"text": text}) if as_json else text)
        return
    if name == "codes":
        document: object = [vars(code) for code in ISSUE_CODES.values()]
    elif name in JSON_SCHEMAS:
        document = load_schema(name)
    elif name in TABLES:
        document = describe_table(name)
    else:
        raise CallError(
            "there is no such schema",
            found=name,
            required=", ".join([*JSON_SCHEMAS, *TABLES, "codes", "text"]),
        )
    echo(json.dumps(document, indent=1, ensure_ascii=False))
