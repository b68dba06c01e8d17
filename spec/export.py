"""The machine-readable specification as files: JSON Schemas, Arrow schemas, the text."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from pliant.spec.conventions import SPEC_VERSION
from pliant.spec.errors import CallError
from pliant.spec.io.writing import replacing
from pliant.spec.tables import ANSWERS_OPTIONAL, TABLES

JSON_SCHEMAS: Final = (
    "dataset",
    "sequence",
    "cameras",
    "manifest",
    *(f"footer-{name}" for name in TABLES),
)
"""Names of the JSON Schemas."""

TABLES_FILE: Final = "tables.json"

_ROOT = files("pliant.spec")


def describe_table(name: str) -> dict[str, Any]:
    """Return a table's columns as a JSON object, for readers without Arrow.

    Args:
        name: A key of `TABLES`.
    """
    optional = ANSWERS_OPTIONAL if name == "answers" else pa.schema([])
    columns = [
        {
            "name": field.name,
            "type": type_name(field.type),
            "nullable": field.nullable,
            "required": required,
            **{key.decode(): text.decode() for key, text in (field.metadata or {}).items()},
        }
        for schema, required in ((TABLES[name], True), (optional, False))
        for field in schema
    ]
    return {"table": name, "columns": columns}


def type_name(kind: pa.DataType) -> str:
    """Return an Arrow type in the words of SPEC.md, such as `list<{u: float32, v: float32}>`."""
    if pa.types.is_list(kind):
        return f"list<{type_name(kind.value_type)}>"
    if pa.types.is_struct(kind):
        inner = ", ".join(f"{part.name}: {type_name(part.type)}" for part in kind)
        return f"{{{inner}}}"
    return {"float": "float32", "double": "float64"}.get(str(kind), str(kind))


def generated_files() -> dict[str, bytes]:
    """Return name -> bytes of the schema files that are made from `pliant.spec.tables`."""
    made = {f"{name}.arrow": schema.serialize().to_pybytes() for name, schema in TABLES.items()}
    made["answers-optional.arrow"] = ANSWERS_OPTIONAL.serialize().to_pybytes()
    tables = {name: describe_table(name) for name in TABLES}
    made[TABLES_FILE] = (json.dumps(tables, indent=1, ensure_ascii=False) + "\n").encode()
    return made


def specification_files() -> dict[str, bytes]:
    """Return name -> bytes of all schema files and of SPEC.md, as they are shipped."""
    folder = _ROOT / "schemas" / SPEC_VERSION
    shipped = {
        f"schemas/{SPEC_VERSION}/{entry.name}": entry.read_bytes()
        for entry in sorted(folder.iterdir(), key=lambda entry: entry.name)
        if entry.is_file()
    }
    return {"SPEC.md": (_ROOT / "SPEC.md").read_bytes(), **shipped}


def write_specification(out: Path) -> list[Path]:
    """Write SPEC.md and all schemas into a folder; return the files written.

    Args:
        out: The folder; made if it is not there.

    Raises:
        CallError: It cannot be written.
    """
    written = []
    try:
        for name, data in specification_files().items():
            path = out / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path) as partial:
                partial.write_bytes(data)
            written.append(path)
    except OSError as error:
        raise CallError("the folder cannot be written", path=out, found=error.strerror) from error
    return written
