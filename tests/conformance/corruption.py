"""Random corruptions of a valid dataset, and an independent judge of the harmless ones.

The mutation sweep draws thousands of them. A corruption that the validator does not report
must be harmless: what the files say, as decoded here, is what they said before, up to the
tolerances of the annex on validation and to what it does not check.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.storage import layout
from tests.conformance.base import relist

Rng = np.random.Generator
Kind = Callable[[Path, Rng], str]

ODD_VALUES: Final[tuple[Any, ...]] = (
    None,
    True,
    -1,
    0,
    3,
    1e300,
    "",
    "x" * 1000,
    [],
    {},
    [[]],
    "../..",
    "2.0.0",
)


def corrupt(root: Path, rng: Rng) -> str:
    """Corrupt a dataset in one random way; return what was done.

    Half of the time the checksums are brought up to date afterwards, as somebody would who
    edits a dataset on purpose.

    Args:
        root: A copy of a valid dataset.
        rng: Where every choice comes from.
    """
    kind = _KINDS[int(rng.integers(len(_KINDS)))]
    text = kind(root, rng)
    if rng.random() < 0.5:
        _relist_all(root)
        text += "; checksums brought up to date"
    return text


def _relist_all(root: Path) -> None:
    for path in sorted(root.rglob(layout.SEQUENCE_JSON)):
        try:
            document = json.loads(path.read_text())
        except ValueError:
            continue
        if isinstance(document, dict):
            relist(path.parent, document)


def _choice(rng: Rng, items: list[Any]) -> Any:
    return items[int(rng.integers(len(items)))]


def _any_file(root: Path, rng: Rng, suffix: str = "") -> Path:
    files = [p for p in sorted(root.rglob(f"*{suffix}")) if p.is_file()]
    found: Path = _choice(rng, files)
    return found


def _flip(root: Path, rng: Rng) -> str:
    path = _any_file(root, rng)
    data = bytearray(path.read_bytes())
    places = rng.integers(len(data), size=int(rng.integers(1, 9)))
    for place in places:
        data[place] ^= 1 << int(rng.integers(8))
    path.write_bytes(data)
    return f"flipped bits of {path.relative_to(root)} at {places.tolist()}"


def _truncate(root: Path, rng: Rng) -> str:
    path = _any_file(root, rng)
    data = path.read_bytes()
    length = int(rng.integers(len(data)))
    path.write_bytes(data[:length])
    return f"cut {path.relative_to(root)} to {length} bytes"


def _append(root: Path, rng: Rng) -> str:
    path = _any_file(root, rng)
    extra = rng.bytes(int(rng.integers(1, 100)))
    path.write_bytes(path.read_bytes() + extra)
    return f"appended {len(extra)} bytes to {path.relative_to(root)}"


def _swap(root: Path, rng: Rng) -> str:
    first = _any_file(root, rng)
    second = _any_file(root, rng, first.suffix)
    data = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(data)
    return f"swapped {first.relative_to(root)} and {second.relative_to(root)}"


def _remove(root: Path, rng: Rng) -> str:
    path = _any_file(root, rng)
    path.unlink()
    return f"removed {path.relative_to(root)}"


def _edit_number(root: Path, rng: Rng) -> str:
    """Change one number, or word, of one table."""
    path = _any_file(root, rng, ".parquet")
    table = pq.read_table(path)
    row = int(rng.integers(table.num_rows))
    name = _choice(rng, [n for n in table.column_names if n != "alternatives"])
    values = table.column(name).to_pylist()
    old = values[row]
    if isinstance(old, float):
        steps = [old + 1e-3, old + 0.5, old * 1.1, -old, 0.0, old + 100, float("nan"), 1e30]
        values[row] = float(np.float32(_choice(rng, steps)))
    elif isinstance(old, bool):
        values[row] = not old
    elif isinstance(old, int):
        values[row] = old + int(_choice(rng, [1, -1, 5, -old - 1, 2**31 - 1 - old]))
    elif isinstance(old, str):
        words = ["visible", "self_occluded", "occluded", "out_of_frame", "train", "test", "", "é"]
        values[row] = _choice(rng, words)
    elif isinstance(old, list):
        values[row] = old[::-1] if old and rng.random() < 0.5 else old[:-1]
    else:
        values[row] = _choice(rng, [0.5, -1.0]) if name == "coverage" else "other"
    if name == "visibility" and _on_line(path, table, row):
        return "nothing: the state of a centre-line point is left alone"
    index = table.column_names.index(name)
    column = pa.array(values, table.schema.field(name).type)
    pq.write_table(table.set_column(index, table.schema.field(name), column), path)
    return f"{path.relative_to(root)}, {name}[{row}]: {old!r} becomes {values[row]!r}"


def _on_line(path: Path, table: pa.Table, row: int) -> bool:
    """Return whether a row is of a centre-line point, whose state no summary counts."""
    point = table.column("point")[row].as_py()
    kinds = pq.read_table(path.with_name(layout.POINTS_TABLE)).column("kind").to_pylist()
    return bool(kinds[point] == "centreline")


def _table(change: Callable[[pa.Table, Rng], tuple[pa.Table, str]]) -> Kind:
    """Return a corruption that changes one table."""

    def corruption(root: Path, rng: Rng) -> str:
        path = _any_file(root, rng, ".parquet")
        table, text = change(pq.read_table(path), rng)
        pq.write_table(table, path)
        return f"{text} of {path.relative_to(root)}"

    return corruption


def _drop_rows(table: pa.Table, rng: Rng) -> tuple[pa.Table, str]:
    keep = np.ones(table.num_rows, np.bool_)
    start = int(rng.integers(table.num_rows))
    keep[start : start + int(rng.integers(1, 5))] = False
    return table.filter(pa.array(keep)), f"dropped {np.count_nonzero(~keep)} rows from {start}"


def _shuffle_rows(table: pa.Table, rng: Rng) -> tuple[pa.Table, str]:
    return table.take(pa.array(rng.permutation(table.num_rows))), "shuffled the rows"


def _drop_column(table: pa.Table, rng: Rng) -> tuple[pa.Table, str]:
    name = _choice(rng, table.column_names)
    return table.drop_columns([name]), f"dropped the column {name}"


def _retype_column(table: pa.Table, rng: Rng) -> tuple[pa.Table, str]:
    name = _choice(rng, table.column_names)
    column = table.column(name)
    kinds = [pa.float64(), pa.int64(), pa.string(), pa.large_string(), pa.int8(), pa.binary()]
    kind = _choice(rng, kinds)
    try:
        column = column.cast(kind)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        column = pa.array([None] * table.num_rows, kind)
    field = pa.field(name, kind, nullable=True)
    changed = table.set_column(table.column_names.index(name), field, column)
    return changed, f"made the column {name} {kind}"


def _swap_columns(table: pa.Table, rng: Rng) -> tuple[pa.Table, str]:
    """Exchange the contents of two columns of one type."""
    first = _choice(rng, table.column_names)
    kind = table.schema.field(first).type
    second = _choice(rng, [f.name for f in table.schema if f.type == kind])
    columns = {first: table.column(second), second: table.column(first)}
    for name, column in columns.items():
        field = table.schema.field(name).with_nullable(True)
        table = table.set_column(table.column_names.index(name), field, column)
    return table, f"exchanged {first} and {second}"


def _edit_json(root: Path, rng: Rng) -> str:
    """Change, remove or add one value of one document."""
    path = _any_file(root, rng, ".json")
    document = json.loads(path.read_text())
    node, place = document, ""
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        if not keys:
            return f"nothing: {path.relative_to(root)}{place} is empty"
        key = _choice(rng, keys)
        place += f"[{key!r}]"
        if isinstance(node[key], dict | list) and node[key] and rng.random() < 0.85:
            node = node[key]
            continue
        break
    action = int(rng.integers(3))
    if action == 0:
        del node[key]
    elif action == 1 and isinstance(node[key], int | float) and not isinstance(node[key], bool):
        node[key] += float(_choice(rng, [1e-3, 1.0, -1.0, 100.0]))
    else:
        node[key] = _choice(rng, list(ODD_VALUES))
    path.write_text(json.dumps(document))
    return f"edited {path.relative_to(root)} at {place}"


_KINDS: Final[tuple[Kind, ...]] = (
    _flip,
    _flip,
    _truncate,
    _append,
    _swap,
    _remove,
    _edit_number,
    _edit_number,
    _edit_number,
    _table(_drop_rows),
    _table(_shuffle_rows),
    _table(_drop_column),
    _table(_retype_column),
    _table(_swap_columns),
    _edit_json,
    _edit_json,
)


def restore(base: Path, root: Path) -> None:
    """Bring a corrupted copy back to its base, a valid dataset."""
    shutil.rmtree(root)
    shutil.copytree(base, root)
