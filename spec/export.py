"""The machine-readable specification as files: JSON Schemas, Arrow schemas, the text."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Final

from pliant.spec.errors import CallError
from pliant.spec.io.jsonfiles import SCHEMAS
from pliant.spec.io.writing import replacing
from pliant.spec.tables import TABLES

JSON_SCHEMAS: Final = (
    "dataset",
    "sequence",
    "cameras",
    "manifest",
    *(f"footer-{name}" for name in TABLES),
)
"""Names of the JSON Schemas."""


def specification_files() -> dict[str, bytes]:
    """Return name -> bytes of SPEC.md, its annexes and all schema files."""
    shipped = {
        f"schemas/{folder.name}/{entry.name}": entry.read_bytes()
        for folder in sorted(SCHEMAS.iterdir(), key=lambda folder: folder.name)
        for entry in sorted(folder.iterdir(), key=lambda entry: entry.name)
    }
    package = files("pliant.spec")
    annexes = {
        f"annexes/{entry.name}": entry.read_bytes()
        for entry in sorted((package / "annexes").iterdir(), key=lambda entry: entry.name)
    }
    return {"SPEC.md": (package / "SPEC.md").read_bytes(), **annexes, **shipped}


def write_specification(out: Path) -> list[Path]:
    """Write SPEC.md, its annexes and all schemas into a folder; return the files written.

    Args:
        out: The folder; created if it does not exist.

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
