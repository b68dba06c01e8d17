"""Keeps SPEC.md, its annexes and the Arrow schemas equal to the JSON Schemas and to `tables.json`.

`python -m tests.spec_document --check` fails if a generated part is stale; `--write` writes it
again. A generated part is between `<!-- generated: WHAT -->` and `<!-- end -->`.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from pliant.spec.conventions import SPEC_VERSION
from pliant.spec.io import limits
from pliant.spec.io.jsonfiles import load_schema
from pliant.spec.tables import ANSWERS_OPTIONAL, COLUMNS, TABLES
from pliant.spec.validation.issue_codes import ISSUE_CODES
from tests import spec_walkthrough as walkthrough

HERE: Final = Path(__file__).resolve().parents[1] / "spec"
TEXTS: Final = (HERE / "SPEC.md", *sorted((HERE / "annexes").glob("*.md")))
PAGES: Final = (HERE.parent / "docs" / "errors.md",)
"""Other pages with generated parts."""
SCHEMAS: Final = HERE / "schemas" / SPEC_VERSION

JSON_SCHEMAS: Final = (
    "dataset",
    "sequence",
    "cameras",
    "manifest",
    *(f"footer-{name}" for name in TABLES),
)
"""Names of the JSON Schemas."""

_PART = re.compile(r"(<!-- generated: ([a-z -]+) -->\n).*?(<!-- end -->)", re.DOTALL)

_LIMITS = {
    "MAX_JSON_BYTES": "bytes of a JSON file",
    "MAX_JSON_DEPTH": "levels of nesting in a JSON file",
    "MAX_FOOTER_BYTES": "bytes of the `pliant` footer object of a table",
    "MAX_IMAGE_SIDE_PX": "pixels of an image's side",
    "MAX_IMAGE_PIXELS": "pixels of an image",
    "MAX_IMAGE_FILE_BYTES": "bytes of an image file",
    "MAX_FRAMES": "frames of a sequence",
    "MAX_POINTS": "points of a sequence",
    "MAX_CORRESPONDENCE_ROWS": "rows of a correspondence table",
    "MAX_TABLE_ROWS": "rows of any other table",
    "MAX_SEQUENCES": "sequences of a dataset",
    "MAX_TABLE_BYTES": "bytes of a Parquet file",
    "MAX_CHUNK_BYTES": "uncompressed bytes of a column chunk",
    "MAX_CHUNK_VALUES": "values of a column chunk",
    "MAX_NAME_LENGTH": "characters of a name of a tier or sequence",
}


def render_part(what: str) -> str:
    """Return the text of a generated part.

    Args:
        what: `schema NAME`, `table NAME`, `types NAME`, `rows NAME`, `document NAME`,
            `codes SUBJECT`, `remedies SUBJECT` or `limits`.
    """
    kind, _, name = what.partition(" ")
    if kind == "types":
        return walkthrough.types(name)
    if kind == "rows":
        return _table(*walkthrough.rows(name))
    if kind == "document":
        return walkthrough.document(name)
    if kind == "schema":
        return _table(("field", "type", "unit", "meaning"), _schema_rows(load_schema(name)))
    if kind == "table":
        return _table(("column", "type", "unit", "range", "meaning"), _column_rows(name))
    if kind in ("codes", "remedies"):
        head = ("code", "severity", "reported when", "usual cause", "remedy")
        columns = 3 if kind == "codes" else 5
        codes = [code for code in ISSUE_CODES.values() if code.subject in (name, "both")]
        shown = [(f"`{c.code}`", c.severity, c.meaning, c.cause, c.remedy) for c in codes]
        return _table(head[:columns], [line[:columns] for line in shown])
    lines = [(f"{getattr(limits, key):,}", text) for key, text in _LIMITS.items()]
    return _table(("at most", "of what"), lines)


def render(text: str) -> str:
    """Return the text with every generated part written again."""
    return _PART.sub(lambda match: f"{match[1]}{render_part(match[2])}{match[3]}", text)


def _table(head: tuple[str, ...], rows: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _schema_rows(schema: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str, str, str]]:
    required = set(schema.get("required", ()))
    for name, entry in schema["properties"].items():
        place = f"{prefix}{name}"
        kind = _kind(entry) + ("" if name in required else ", optional")
        yield f"`{place}`", kind, entry.get("unit", ""), entry["description"]
        inner = entry
        while "items" in inner:
            inner, place = inner["items"], f"{place}[]"
        if "properties" in inner:
            yield from _schema_rows(inner, f"{place}.")


def _kind(entry: dict[str, Any]) -> str:
    if "const" in entry:
        return f"`{entry['const']!r}`".replace("'", '"')
    if "enum" in entry:
        return " \\| ".join(f"`{value}`" for value in entry["enum"]).replace("\\|", "or")
    kinds = entry.get("type", "any")
    kind = " or ".join(kinds) if isinstance(kinds, list) else kinds
    if kind == "array":
        kind = _array(entry)
    notes = []
    for key, sign in (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤")):
        if key in entry:
            notes.append(f"{sign} {entry[key]}")
    if "pattern" in entry:
        notes.append(f"pattern `{entry['pattern']}`")
    return kind + (f", {', '.join(notes)}" if notes else "")


def _array(entry: dict[str, Any]) -> str:
    shape = []
    inner = entry
    while inner.get("type") == "array":
        low, high = inner.get("minItems"), inner.get("maxItems")
        shape.append(str(low) if low == high and low is not None else "n")
        inner = inner["items"]
    return f"array ({' × '.join(shape)}) of {_kind(inner)}"


def _column_rows(name: str) -> Iterator[tuple[str, str, str, str, str]]:
    for column in COLUMNS[name]["columns"]:
        kind = column["type"] + (" or null" if column["nullable"] else "")
        if not column["required"]:
            kind += ", optional"
        yield (
            f"`{column['name']}`",
            kind,
            column.get("unit", ""),
            column.get("range", ""),
            column["doc"],
        )


def arrow_files() -> dict[str, bytes]:
    """Return name -> bytes of the Arrow schema files, which are made from `tables.json`."""
    schemas = {**TABLES, "answers-optional": ANSWERS_OPTIONAL}
    return {f"{name}.arrow": each.serialize().to_pybytes() for name, each in schemas.items()}


def stale() -> list[str]:
    """Return what differs from the code: parts of the texts and schema files, by name."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in (*TEXTS, *PAGES))
    names = [match[2] for match in _PART.finditer(text) if not match[0].endswith(_whole(match[2]))]
    required = {f"schema {name}" for name in JSON_SCHEMAS} | {f"table {name}" for name in COLUMNS}
    names += sorted(required - {match[2] for match in _PART.finditer(text)})
    for name, data in arrow_files().items():
        path = SCHEMAS / name
        if not path.is_file() or path.read_bytes() != data:
            names.append(f"schemas/{SPEC_VERSION}/{name}")
    return names


def _whole(what: str) -> str:
    return f"<!-- generated: {what} -->\n{render_part(what)}<!-- end -->"


def main() -> None:
    """Run as a program."""
    parser = argparse.ArgumentParser(description=__doc__)
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--check", action="store_true", help="fail if a generated part is stale")
    action.add_argument("--write", action="store_true", help="write the generated parts again")
    if parser.parse_args().write:
        for path in (*TEXTS, *PAGES):
            path.write_text(render(path.read_text(encoding="utf-8")), encoding="utf-8")
        for name, data in arrow_files().items():
            (SCHEMAS / name).write_bytes(data)
    names = stale()
    if names:
        sys.exit("Stale: " + ", ".join(names) + ". Run: python -m tests.spec_document --write")


if __name__ == "__main__":
    main()
