"""Parquet tables: written with a footer that says what they are, read within limits."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.conventions import FOOTER_KEY, SPEC_VERSION
from pliant.spec.io import limits
from pliant.spec.io.jsonfiles import parse_json
from pliant.spec.io.parquet_columns import load_columns
from pliant.spec.io.parquet_footer import read_column_chunks, unreadable
from pliant.spec.io.reading import AnyFile, Blob, FileRefusedError, check_regular
from pliant.spec.io.writing import replacing
from pliant.spec.tables import TABLES

_ROW_GROUP_ROWS: Final = 65536
_THRIFT_LIMIT: Final = 16 * 2**20


_OPTIONS: Final[dict[str, Any]] = {
    "compression": "zstd",
    "compression_level": 3,
    "version": "2.6",
    "data_page_version": "1.0",
    "write_statistics": True,
}


def write_table(
    path: Path | str, table: pa.Table, name: str, footer: Mapping[str, Any] | None = None
) -> None:
    """Write a table; equal tables give equal bytes.

    Args:
        path: Where to; replaced if it exists.
        table: Columns of `TABLES[name]` (a submission may have more), in any order and of
            types that cast to the declared ones without loss.
        name: A key of `TABLES`.
        footer: What the `pliant` footer object contains other than `spec_version` and `table`.

    Raises:
        ValueError: A column is missing, of another type, or holds a null it must not.
        CallError: The file cannot be written; an earlier one is unchanged.
    """
    described = _described(table, name, footer)
    with replacing(path) as partial:
        pq.write_table(described, partial, row_group_size=_ROW_GROUP_ROWS, **_OPTIONS)


class TableWriter:
    """Writes a table piece by piece, so that a long one is never in memory whole.

    Every piece becomes a row group (several, if it has more than 65,536 rows). Use it as a
    context manager: the file is whole once that is left.

    Args:
        path: Where to; replaced if it exists.
        name: A key of `TABLES`.
        footer: What the `pliant` footer object contains other than `spec_version` and `table`.
    """

    def __init__(
        self, path: Path | str, name: str, footer: Mapping[str, Any] | None = None
    ) -> None:
        self._name, self._footer = name, footer
        schema = _described(TABLES[name].empty_table(), name, footer).schema
        self._file = pq.ParquetWriter(path, schema, **_OPTIONS)

    def __enter__(self) -> TableWriter:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """Write the footer; the file is whole now."""
        self._file.close()

    def write(self, table: pa.Table) -> None:
        """Append rows; columns and errors as in `write_table`."""
        described = _described(table, self._name, self._footer)
        self._file.write_table(described, row_group_size=_ROW_GROUP_ROWS)


def _described(table: pa.Table, name: str, footer: Mapping[str, Any] | None) -> pa.Table:
    """Return a table in the declared types and order, with the footer as its metadata."""
    schema = TABLES[name]
    missing = [field.name for field in schema if field.name not in table.column_names]
    if missing:
        raise ValueError(f"table {name} lacks the columns {missing}")
    columns, fields = [], []
    for field in schema:
        column = table.column(field.name)
        if column.type != field.type:
            column = column.cast(field.type)
        if not field.nullable and column.null_count:
            raise ValueError(f"table {name}, column {field.name}: null is not allowed")
        columns.append(column)
        fields.append(field)
    for extra in table.schema:
        if extra.name not in schema.names:
            if name not in ("answers", "matches"):
                raise ValueError(f"table {name} has no column {extra.name}")
            columns.append(table.column(extra.name))
            fields.append(extra)
    content = {"spec_version": SPEC_VERSION, "table": name, **(footer or {})}
    text = json.dumps(content, sort_keys=True, allow_nan=False, ensure_ascii=False)
    return pa.Table.from_arrays(
        columns, schema=pa.schema(fields, metadata={FOOTER_KEY: text.encode()})
    )


def open_table(path: AnyFile, *, max_rows: int = limits.MAX_TABLE_ROWS) -> pq.ParquetFile:
    """Open a Parquet file after checking, from its footer alone, how much it announces.

    Text is decoded to dictionaries, so that a long text repeated in every row takes the memory
    of one; text in a delta encoding, for which Arrow cannot do this, is decoded as it is.

    Args:
        path: The file.
        max_rows: The most rows allowed.

    Raises:
        FileRefusedError: Missing, no Parquet, damaged, or it announces too much.
    """
    check_regular(path, limits.MAX_TABLE_BYTES)
    chunks = read_column_chunks(path)  # never metadata.row_group(i).column(j): see there
    delta = {".".join(chunk.path) for chunk in chunks if chunk.has_delta_text}
    text = {".".join(chunk.path) for chunk in chunks if chunk.is_text}
    file = _open(path, sorted(text - delta))
    metadata = file.metadata
    groups = [metadata.row_group(index) for index in range(metadata.num_row_groups)]
    if metadata.num_rows < 0 or metadata.num_rows != sum(group.num_rows for group in groups):
        raise unreadable(path, "row counts that contradict each other")
    if metadata.num_rows > max_rows:
        raise FileRefusedError(
            "FILE_TOO_LARGE",
            "the table announces more rows than allowed",
            path=path,
            found=f"{metadata.num_rows} rows",
            required=f"at most {max_rows}",
        )
    for chunk in chunks:
        if chunk.uncompressed_bytes > limits.MAX_CHUNK_BYTES or (
            chunk.values > limits.MAX_CHUNK_VALUES
        ):
            raise FileRefusedError(
                "FILE_TOO_LARGE",
                "a column chunk announces more than allowed",
                path=path,
                where=".".join(chunk.path),
                found=f"{chunk.values} values, {chunk.uncompressed_bytes} bytes",
                required=f"at most {limits.MAX_CHUNK_VALUES} values, "
                f"{limits.MAX_CHUNK_BYTES} bytes",
            )
    return file


def _open(path: AnyFile, dictionaries: list[str]) -> pq.ParquetFile:
    try:
        return pq.ParquetFile(
            pa.BufferReader(path.data) if isinstance(path, Blob) else path,
            read_dictionary=dictionaries,
            pre_buffer=False,  # which keeps every byte it has read until the file is closed
            thrift_string_size_limit=_THRIFT_LIMIT,
            thrift_container_size_limit=_THRIFT_LIMIT,
        )
    except Exception as error:  # Arrow's errors do not share a base
        raise unreadable(path, error) from error


def read_table(path: AnyFile, name: str, columns: Sequence[str] | None = None) -> pa.Table:
    """Read a table in the declared types and column order.

    Args:
        path: The file.
        name: A key of `TABLES`.
        columns: Names to read, or None for all declared ones.

    Returns:
        Exactly the requested columns, typed as declared, without the file's metadata.

    Raises:
        FileRefusedError: Missing, damaged, too large; a column missing, of another type or with
            a null it must not hold.
    """
    schema = TABLES[name]
    if columns is not None:
        schema = pa.schema([schema.field(column) for column in columns])
    return load_columns(open_table(path), path, schema)


def read_footer(path: AnyFile) -> dict[str, Any]:
    """Return the `pliant` footer object of a Parquet file.

    Args:
        path: The file.

    Raises:
        FileRefusedError: Missing, damaged, or without a footer object.
    """
    return footer_of(open_table(path, max_rows=limits.MAX_FOOTER_ONLY_ROWS), path)


def footer_of(file: pq.ParquetFile, path: AnyFile) -> dict[str, Any]:
    """Return the `pliant` footer object of an open file; errors as `read_footer`."""
    metadata = file.metadata.metadata or {}
    if FOOTER_KEY not in metadata:
        raise FileRefusedError(
            "FOOTER_MISSING",
            "the Parquet footer has no `pliant` entry",
            path=path,
            fix="Write the JSON object of SPEC.md under the footer's key `pliant`.",
        )
    text = metadata[FOOTER_KEY]
    if len(text) > limits.MAX_FOOTER_BYTES:
        raise FileRefusedError("FILE_TOO_LARGE", "the `pliant` footer is too long", path=path)
    try:
        footer = parse_json(text, path)
    except FileRefusedError as error:
        raise FileRefusedError(
            "FOOTER_INVALID",
            f"the `pliant` footer: {error.message}",
            path=path,
            where=error.where and f"footer {error.where}",
            found=error.found,
            fix=error.fix,
        ) from error
    if not isinstance(footer, dict):
        raise FileRefusedError(
            "FOOTER_INVALID", "the `pliant` footer is not a JSON object", path=path
        )
    return footer
