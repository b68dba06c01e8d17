"""The documents and table rows that SPEC.md shows: those of `spec/examples/write_dataset.py`."""

from __future__ import annotations

import json
import runpy
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.tables import COLUMNS

EXAMPLES: Final = Path(__file__).resolve().parents[1] / "spec" / "examples"
SEQUENCE: Final = Path("sequences/card/card-test-000000")
FILES: Final = {
    "points": SEQUENCE / "points.parquet",
    "correspondences": SEQUENCE / "correspondences.parquet",
    "queries": Path("queries/test.parquet"),
    "truth": Path("truth/test.parquet"),
    "answers": Path("answers.parquet"),
}
SHOWN: Final = {"points": (0, 8), "correspondences": (0, 9, 11), "queries": (1, 3)}
"""Rows of a table that SPEC.md shows; of the others those of the queries."""


def write(root: Path) -> None:
    """Run the Python example: the dataset in `root`, the submission in `root/answers.parquet`."""
    program, before = EXAMPLES / "write_dataset.py", sys.argv
    sys.argv = [str(program), str(root), str(root / "answers.parquet")]
    try:
        runpy.run_path(str(program), run_name="__main__")
    finally:
        sys.argv = before


@cache
def _written() -> tuple[dict[str, Any], dict[str, pa.Table]]:
    """Return the JSON documents and the tables of the example, by name."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        write(root)
        tables = {name: pq.read_table(root / path) for name, path in FILES.items()}
        places = {"dataset": root, "sequence": root / SEQUENCE, "cameras": root / SEQUENCE}
        documents = {
            name: json.loads((place / f"{name}.json").read_text()) for name, place in places.items()
        }
    return documents, tables


def types(name: str) -> str:
    """Return a table's columns and types in one line."""
    columns = (
        f"`{column['name']}: {column['type']}{' or null' if column['nullable'] else ''}`"
        + ("" if column["required"] else " (optional)")
        for column in COLUMNS[name]["columns"]
    )
    return ", ".join(columns) + ".\n"


def rows(name: str) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the head and some rows of a table."""
    table = _written()[1][name]
    shown = table.take(list(SHOWN.get(name, SHOWN["queries"]))).to_pylist()
    return tuple(table.column_names), [tuple(map(_cell, row.values())) for row in shown]


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, dict):
        return "{" + ", ".join(map(_cell, value.values())) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_cell, value)) + "]"
    return str(value)


def document(name: str) -> str:
    """Return a JSON document as an example; of files and cameras only the first."""
    content = dict(_written()[0][name])
    for key in {"sequence": ["files"], "cameras": ["frames"]}.get(name, []):
        content[key] = content[key][:1]
    lines = [f" {json.dumps(key)}: {_folded(value)}" for key, value in content.items()]
    return f"```json {name}\n{{\n" + ",\n".join(lines) + "\n}\n```\n"


def _folded(value: Any, indent: int = 1, width: int = 110) -> str:
    """Return a JSON value in one line if it fits, else one line per member."""
    line = json.dumps(value)
    if len(line) + indent <= width or not isinstance(value, dict | list) or not value:
        return line
    pad = " " * (indent + 1)
    members = (
        [f"{json.dumps(key)}: {_folded(each, indent + 1)}" for key, each in value.items()]
        if isinstance(value, dict)
        else [_folded(each, indent + 1) for each in value]
    )
    first, last = ("{", "}") if isinstance(value, dict) else ("[", "]")
    return f"{first}\n{pad}" + f",\n{pad}".join(members) + f"\n{' ' * indent}{last}"
