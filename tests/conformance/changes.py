"""What the steps of a case compute: changes of bytes, documents, rows and tables, by name."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

Rows = list[dict[str, Any]]
Document = dict[str, Any]

# Bytes.


def keep(data: bytes, end: int) -> bytes:
    """Keep the first bytes; a negative number counts from the end."""
    return data[:end]


def keep_half(data: bytes) -> bytes:
    return data[: len(data) // 2]


def append(data: bytes, text: str) -> bytes:
    return data + text.encode()


def replace(data: bytes, old: str, new: str) -> bytes:
    return data.replace(old.encode(), new.encode())


def utf16(data: bytes) -> bytes:
    return data.decode().encode("utf-16")


def flip(data: bytes) -> bytes:
    """Flip a bit in the middle."""
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


def bomb(data: bytes) -> bytes:
    """Let the header of a PNG claim 100,000 x 100,000 pixels, with a good checksum."""
    header = struct.pack(">II", 100_000, 100_000) + data[24:29]
    checksum = struct.pack(">I", zlib.crc32(b"IHDR" + header))
    return data[:16] + header + checksum + data[33:]


def vast(data: bytes) -> bytes:
    """Let the windows of an EXR header claim 100,000 x 100,000 pixels."""
    window = struct.pack("<4i", 0, 0, 63, 47)
    return data.replace(window, struct.pack("<4i", 0, 0, 99_999, 99_999))


def chunk(data: bytes, kind: str, payload: str) -> bytes:
    """Put a chunk, its content in hexadecimal, in front of the first IDAT of a PNG."""
    content = bytes.fromhex(payload)
    added = len(content).to_bytes(4, "big") + kind.encode() + content
    added += zlib.crc32(kind.encode() + content).to_bytes(4, "big")
    at = data.index(b"IDAT") - 4
    return data[:at] + added + data[at:]


# Documents.


def as_list(document: Document) -> list[Document]:
    return [document]


def as_text(document: Document, text: str) -> bytes:
    return text.encode()


def nest(document: Document, name: str) -> None:
    """Set a field to objects 100 levels deep."""
    deep: Any = {}
    for _ in range(100):
        deep = {"a": deep}
    document[name] = deep


def invert_poses(document: Document) -> None:
    for frame in document["frames"]:
        frame["world_to_camera"] = np.linalg.inv(np.array(frame["world_to_camera"])).tolist()
        frame["world_to_camera"][3] = [0, 0, 0, 1]


def move_camera_along_x(document: Document) -> None:
    """Move the second camera by 2 m along the world's x axis."""
    pose = np.array(document["frames"][1]["world_to_camera"])
    pose[:3, 3] -= pose[:3, 0] * 2
    document["frames"][1]["world_to_camera"] = pose.tolist()


# Rows.


def reverse_rows(rows: Rows) -> None:
    rows.reverse()


def sort_by(rows: Rows, *names: str) -> Rows:
    return sorted(rows, key=lambda row: [row[name] for name in names])


def round_to_pixels(rows: Rows, u: str, v: str) -> None:
    for row in rows:
        row[u], row[v] = float(round(row[u])), float(round(row[v]))


def count_v_upwards(rows: Rows, height: int = 48) -> None:
    for row in rows:
        row["v_px"] = height - row["v_px"]


def exchange_names(rows: Rows, first: str, second: str) -> None:
    for row in rows:
        row[first], row[second] = row[second], row[first]


def lengths_of_rays(rows: Rows) -> None:
    """Turn planar depth into the distance from the camera (f = 85 px, centre (32, 24))."""
    for row in rows:
        x, y = (row["u_px"] - 32) / 85, (row["v_px"] - 24) / 85
        row["depth_m"] *= float(np.sqrt(1 + x * x + y * y))


def move_along_rope(rows: Rows) -> None:
    """Move a point on the far side of the tube, hidden in the only frame, and its partner."""
    partner = rows[0]["partners"][0]
    for row, step in ((rows[0], 0.01), (rows[partner], -0.01)):
        row["m0"] = float(np.float32(row["m0"] + step))


def copy_partner(rows: Rows) -> None:
    """Repeat the first partner of each point."""
    for row in rows:
        row["partners"].append(row["partners"][0])


def add_itself(rows: Rows) -> None:
    """Make each point its own last partner."""
    for row in rows:
        row["partners"].append(row["point"])


def share_summary(rows: Rows) -> None:
    """Give the second sequence the self-occlusion of the first."""
    rows[1]["self_occluded"] = rows[0]["self_occluded"]


def change_state(rows: Rows) -> None:
    state = rows[0]["visibility_b"]
    rows[0]["visibility_b"] = "occluded" if state == "visible" else "visible"


# Tables.


def without_footer(table: pa.Table) -> pa.Table:
    return table.replace_schema_metadata({})


def without_column(table: pa.Table, name: str) -> pa.Table:
    return table.drop_columns([name])


def with_weights(table: pa.Table) -> pa.Table:
    return table.append_column("weight", pa.array(np.ones(table.num_rows, np.float32)))


def with_null(table: pa.Table, name: str, row: int = 5) -> pa.Table:
    """Make a value of a column null."""
    values = table.column(name).to_pylist()
    values[row] = None
    field = table.schema.field(name).with_nullable(True)
    return _replaced(table, name, pa.array(values, field.type), field)


def with_null_partner(table: pa.Table) -> pa.Table:
    values = table.column("partners").to_pylist()
    values[0] = [None, *values[0][1:]]
    return _replaced(table, "partners", pa.array(values, pa.list_(pa.int32())))


def cast(table: pa.Table, name: str, kind: str) -> pa.Table:
    """Cast a column: to a type by its name, its lists to lists of it, or to text."""
    column = table.column(name)
    if kind == "text":
        return _replaced(table, name, pa.array([str(value) for value in column.to_pylist()]))
    target = pa.type_for_alias(kind)
    nested = pa.types.is_list(column.type)
    return _replaced(table, name, column.cast(pa.list_(target) if nested else target))


def _replaced(
    table: pa.Table, name: str, array: pa.Array, field: pa.Field | None = None
) -> pa.Table:
    index = table.column_names.index(name)
    return table.set_column(index, field or pa.field(name, array.type), array)


def one_point_a_million_times(table: pa.Table) -> pa.Table:
    """Return more points than the limit; every column repeats one value."""
    count = 1_000_001
    zeros = np.zeros(count, np.int32)
    columns = [
        pa.array(zeros),
        pa.array(zeros + 1),
        pa.array(["surface"] * count),
        pa.array(zeros.astype(np.float32)),
        pa.array(zeros.astype(np.float32)),
        pa.ListArray.from_arrays(np.zeros(count + 1, np.int32), pa.array([], pa.int32())).cast(
            table.schema.field("partners").type
        ),
    ]
    return pa.Table.from_arrays(columns, schema=table.schema)


def optional_columns(table: pa.Table) -> pa.Table:
    fields = [field.with_nullable(True) for field in table.schema]
    return table.cast(pa.schema(fields, metadata=table.schema.metadata))


def reverse_columns(table: pa.Table) -> pa.Table:
    return table.select(table.column_names[::-1])


def every_column(table: pa.Table, form: str) -> pa.Table:
    """Store all columns, and what they contain, in another of Arrow's forms; all are optional."""
    change = _FORMS[form] if form == "views" else partial(_inside, _FORMS[form])
    columns = [change(column.combine_chunks()) for column in table.columns]
    return pa.table(columns, names=table.column_names, metadata=table.schema.metadata)


def _inside(form: Callable[[pa.Array], pa.Array], array: pa.Array) -> pa.Array:
    """Apply a form to an array and to what its lists and structs contain."""
    if pa.types.is_list(array.type):
        array = pa.ListArray.from_arrays(array.offsets, _inside(form, array.values))
    elif pa.types.is_struct(array.type):
        names = [field.name for field in array.type]
        parts = [_inside(form, part) for part in array.flatten()]
        array = pa.StructArray.from_arrays(parts, names)
    return form(array)


def _large(array: pa.Array) -> pa.Array:
    if pa.types.is_list(array.type):
        return pa.LargeListArray.from_arrays(array.offsets.cast(pa.int64()), array.values)
    return array.cast(pa.large_string()) if pa.types.is_string(array.type) else array


def _views(array: pa.Array) -> pa.Array:
    if pa.types.is_list(array.type):
        lengths = pc.list_value_length(array)
        return pa.ListViewArray.from_arrays(array.offsets[:-1], lengths, array.values)
    return array.cast(pa.string_view()) if pa.types.is_string(array.type) else array


def _dictionaries(array: pa.Array) -> pa.Array:
    if pa.types.is_string(array.type):
        return array.dictionary_encode().cast(pa.dictionary(pa.int8(), pa.string()))
    return array


def _reversed_fields(array: pa.Array) -> pa.Array:
    if pa.types.is_struct(array.type):
        names = [field.name for field in array.type]
        return pa.StructArray.from_arrays(array.flatten()[::-1], names[::-1])
    return array


_FORMS = {
    "large": _large,
    "views": _views,
    "dictionaries": _dictionaries,
    "reversed_fields": _reversed_fields,
}
"""64-bit offsets, views, dictionaries with 8-bit indices, structs with their fields reversed."""
