"""Tables as other Parquet writers store them: the same rows, so the dataset stays valid."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from tests.conformance.edits import ROPE_TRAIN, Edit, both, change_table, listed
from tests.conformance.packed import pack

FOREIGN = Path(__file__).resolve().parents[2] / "spec" / "conformance" / "foreign"
"""The truth of `full` as polars, DuckDB and JavaScript write it."""

_TRACKS = f"{ROPE_TRAIN}/correspondences.parquet"
_TRUTH = "truth/test.parquet"
_INDEX = "index.parquet"

_GROUPS = {"row_group_size": 4, "use_dictionary": True}
_PLAIN = {"row_group_size": 4, "use_dictionary": False}
_FALLBACK = {"dictionary_pagesize_limit": 8, "write_batch_size": 2, "data_page_size": 16}
_DELTA = {
    "use_dictionary": False,
    "row_group_size": 4,
    "column_encoding": {
        "pair_id": "DELTA_BINARY_PACKED",
        "tier": "DELTA_BYTE_ARRAY",
        "u_b": "BYTE_STREAM_SPLIT",
        "visibility_b": "DELTA_LENGTH_BYTE_ARRAY",
        "alternatives.list.element.visibility": "DELTA_BYTE_ARRAY",
    },
}


def _rewritten(path: str, **options: Any) -> Any:
    def edit(root: Path) -> None:
        pq.write_table(pq.read_table(root / path), root / path, **options)

    return edit


def _foreign(name: str) -> Any:
    def edit(root: Path) -> None:
        (root / _TRUTH).write_bytes((FOREIGN / f"{name}.parquet").read_bytes())

    return edit


def _every(change: Callable[[pa.Array], pa.Array]) -> Callable[[pa.Table], pa.Table]:
    """Return an edit that changes every column; all become optional."""

    def rewrite(table: pa.Table) -> pa.Table:
        columns = [change(column.combine_chunks()) for column in table.columns]
        return pa.table(columns, names=table.column_names, metadata=table.schema.metadata)

    return rewrite


def _large(array: pa.Array) -> pa.Array:
    """Return text and lists with 64-bit offsets."""
    if pa.types.is_list(array.type):
        offsets = array.offsets.cast(pa.int64())
        return pa.LargeListArray.from_arrays(offsets, _large(array.values))
    if pa.types.is_struct(array.type):
        names = [field.name for field in array.type]
        return pa.StructArray.from_arrays([_large(part) for part in array.flatten()], names)
    return array.cast(pa.large_string()) if pa.types.is_string(array.type) else array


def _views(array: pa.Array) -> pa.Array:
    """Return text and lists as Arrow's views."""
    if pa.types.is_list(array.type):
        lengths = pc.list_value_length(array)
        return pa.ListViewArray.from_arrays(array.offsets[:-1], lengths, array.values)
    return array.cast(pa.string_view()) if pa.types.is_string(array.type) else array


def _dictionaries(array: pa.Array) -> pa.Array:
    """Return text as dictionaries with 8-bit indices, inside lists too."""
    if pa.types.is_list(array.type):
        return pa.ListArray.from_arrays(array.offsets, _dictionaries(array.values))
    if pa.types.is_struct(array.type):
        names = [field.name for field in array.type]
        return pa.StructArray.from_arrays([_dictionaries(part) for part in array.flatten()], names)
    if pa.types.is_string(array.type):
        return array.dictionary_encode().cast(pa.dictionary(pa.int8(), pa.string()))
    return array


def _reversed_fields(array: pa.Array) -> pa.Array:
    """Return structs with their fields in the reverse order."""
    if pa.types.is_list(array.type):
        return pa.ListArray.from_arrays(array.offsets, _reversed_fields(array.values))
    if pa.types.is_struct(array.type):
        names = [field.name for field in array.type]
        return pa.StructArray.from_arrays(array.flatten()[::-1], names[::-1])
    return array


def _large_strings(table: pa.Table) -> pa.Table:
    index = table.column_names.index("visibility")
    column = table.column("visibility").cast(pa.large_string())
    return table.set_column(index, "visibility", column)


def _optional(table: pa.Table) -> pa.Table:
    fields = [field.with_nullable(True) for field in table.schema]
    return table.cast(pa.schema(fields, metadata=table.schema.metadata))


def _reversed_columns(table: pa.Table) -> pa.Table:
    return table.select(table.column_names[::-1])


EDITS: dict[str, Edit] = {
    "parquet-snappy": listed(
        _rewritten(_TRACKS, compression="snappy", row_group_size=17, write_statistics=False)
    ),
    "parquet-v2-pages": listed(_rewritten(_TRACKS, data_page_version="2.0", use_dictionary=False)),
    "text-64-bit-offsets": listed(change_table(_TRACKS, _large_strings)),
    "text-dictionary": listed(change_table(_TRACKS, _every(_dictionaries))),
    "columns-optional": listed(change_table(_TRACKS, _optional)),
    "columns-reversed": listed(change_table(_TRACKS, _reversed_columns)),
    "truth-row-groups": _rewritten(_TRUTH, compression="gzip", **_GROUPS),
    "truth-plain": _rewritten(_TRUTH, **_PLAIN),
    "truth-fallback": _rewritten(_TRUTH, compression="brotli", **_FALLBACK),
    "truth-delta": _rewritten(_TRUTH, compression="lz4", **_DELTA),
    "truth-old-lists": _rewritten(_TRUTH, use_compliant_nested_type=False, **_GROUPS),
    "truth-64-bit-offsets": both(
        change_table(_TRUTH, _every(_large)), _rewritten(_TRUTH, **_GROUPS)
    ),
    "truth-views": change_table(_TRUTH, _every(_views)),
    "truth-dictionaries": both(
        change_table(_TRUTH, _every(_dictionaries)), _rewritten(_TRUTH, **_GROUPS)
    ),
    "truth-fields-reversed": change_table(_TRUTH, _every(_reversed_fields)),
    "truth-by-polars": _foreign("polars"),
    "truth-by-duckdb": _foreign("duckdb"),
    "truth-by-javascript": _foreign("javascript"),
    "index-row-groups": both(pack, _rewritten(_INDEX, row_group_size=1, compression="none")),
    "index-dictionaries": both(
        pack, change_table(_INDEX, _every(_dictionaries)), _rewritten(_INDEX, row_group_size=3)
    ),
}
"""Every way of storing a table that leaves the dataset valid."""
