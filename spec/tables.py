"""The Arrow schema of every Parquet table, made from `schemas/VERSION/tables.json`.

That file declares each column once: name, type, unit, range and meaning; SPEC.md shows it as
tables. Unit, range and meaning are in the metadata of the Arrow fields (`unit`, `range`, `doc`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

import pyarrow as pa

from pliant.spec.io.jsonfiles import read_shipped

COLUMNS: Final[dict[str, dict[str, Any]]] = read_shipped("tables.json")
"""Table -> its description as JSON."""


def arrow_type(text: str) -> pa.DataType:
    """Return the Arrow type of a type in the words of SPEC.md, such as `list<{u: float32}>`.

    Nothing inside a list or a struct is nullable.
    """
    if text.startswith("list<"):
        return pa.list_(pa.field("item", arrow_type(text[5:-1]), nullable=False))
    if text.startswith("{"):
        parts = re.findall(r"(\w+): (\w+)", text)
        return pa.struct([pa.field(name, arrow_type(kind), nullable=False) for name, kind in parts])
    return pa.type_for_alias(text)


def _field(column: Mapping[str, Any]) -> pa.Field:
    metadata = {key: column[key] for key in ("doc", "unit", "range") if key in column}
    kind = arrow_type(column["type"])
    return pa.field(column["name"], kind, nullable=column["nullable"], metadata=metadata)


def _schema(table: str, required: bool) -> pa.Schema:
    columns = COLUMNS[table]["columns"]
    return pa.schema([_field(each) for each in columns if each["required"] == required])


TABLES: Final[dict[str, pa.Schema]] = {name: _schema(name, required=True) for name in COLUMNS}
"""The required columns of every table by its name, as the footer's `table` names it.

Those of a submission (`answers`, `matches`) may be in any order and among others.
"""

ANSWERS_OPTIONAL: Final = _schema("answers", required=False)
"""Columns a submission of kind `answers` may add (`sigma` or `modes`, not both)."""

SEQUENCES: Final = TABLES["sequences"]
POINTS: Final = TABLES["points"]
CORRESPONDENCES: Final = TABLES["correspondences"]
QUERIES: Final = TABLES["queries"]
TRUTH: Final = TABLES["truth"]
INDEX: Final = TABLES["index"]
