"""`pliant spec`: print or write the specification's schemas."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.options import json_option, path_option
from pliant.cli.terminal import echo, echo_json


@click.command()
@click.argument("name", required=False)
@path_option("--out", "PATH", "Write the specification and all schemas into this folder.")
@json_option
def command(name: str | None, out: Path | None, as_json: bool) -> None:
    """Print or write the specification's schemas.

    Without NAME, lists them. NAME is one of the JSON Schemas (dataset, sequence, cameras,
    footer-TABLE), a table (points, correspondences …), `codes` or `text`.
    """
    from pliant.spec.conventions import SPEC_VERSION
    from pliant.spec.errors import CallError
    from pliant.spec.export import JSON_SCHEMAS, specification_files, write_specification
    from pliant.spec.io.jsonfiles import load_schema
    from pliant.spec.tables import COLUMNS
    from pliant.spec.validation.issue_codes import ISSUE_CODES

    groups = {"schemas": list(JSON_SCHEMAS), "tables": list(COLUMNS), "other": ["codes", "text"]}
    document: object
    if out is not None:
        written = write_specification(out)
        document = {"written": [str(path) for path in written]}
        text = f"Wrote {len(written)} files to {out}."
    elif name is None:
        document = {"spec_version": SPEC_VERSION, **groups}
        lines = (f"{title}: {', '.join(names)}" for title, names in groups.items())
        text = "\n".join([f"Specification {SPEC_VERSION}", *lines])
    elif name == "text":
        text = specification_files()["SPEC.md"].decode()
        document = {"text": text}
    else:
        as_json, text = True, ""
        if name == "codes":
            document = [vars(code) for code in ISSUE_CODES.values()]
        elif name in JSON_SCHEMAS:
            document = load_schema(name)
        elif name in COLUMNS:
            document = COLUMNS[name]
        else:
            raise CallError(
                "unknown schema",
                found=name,
                required=", ".join(each for names in groups.values() for each in names),
            )
    if as_json:
        echo_json(document, ensure_ascii=False)
    else:
        echo(text)
