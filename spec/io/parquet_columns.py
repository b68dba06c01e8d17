"""Columns of an open Parquet file, decoded and brought to the declared types.

Writers differ in what they make of one table: optional or required columns, one row group or
many, text with 32-bit or 64-bit offsets, as views or dictionaries, lists of three kinds, the
fields of a struct in another order. All of that is the same table.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pliant.spec.io import limits
from pliant.spec.io.parquet_footer import ColumnChunk, read_column_chunks, unreadable
from pliant.spec.io.reading import AnyFile, FileRefusedError

_BATCH_ROWS: Final = 65536


def load_columns(
    file: pq.ParquetFile,
    path: AnyFile,
    schema: pa.Schema,
    row_groups: Sequence[int] | None = None,
) -> pa.Table:
    """Decode columns of an open file and bring them to the declared types.

    Args:
        file: From `open_table`.
        path: The file, for messages.
        schema: The columns wanted.
        row_groups: Indices of row groups, or None for all.

    Raises:
        FileRefusedError: A column is missing, of another type, damaged or has a null.
    """
    sizes: Counter[str] = Counter()
    tables = [
        _as_declared(table, path, schema, sizes)
        for table in _decode(file, path, schema, row_groups, max(1, file.metadata.num_rows))
    ]
    # An empty table is made of Python lists: pyarrow then imports pandas, which takes 0.2 s.
    return pa.concat_tables(tables) if tables else schema.empty_table()


def load_rows(
    file: pq.ParquetFile, path: AnyFile, schema: pa.Schema, begin: int, end: int
) -> pa.Table:
    """Decode rows [begin, end) of some columns, of the row groups that contain them alone.

    Other arguments and errors as `load_columns`.
    """
    counts = [file.metadata.row_group(index).num_rows for index in range(file.num_row_groups)]
    stops = np.cumsum(counts)
    starts = stops - counts
    groups = np.flatnonzero((starts < end) & (stops > begin)).tolist()
    table = load_columns(file, path, schema, groups)
    return table.slice(begin - int(starts[groups[0]]) if groups else 0, end - begin)


def load_batches(file: pq.ParquetFile, path: AnyFile, schema: pa.Schema) -> Iterator[pa.Table]:
    """Decode columns of an open file little by little; arguments and errors as `load_columns`.

    Args:
        file: From `open_table`.
        path: The file, for messages.
        schema: The columns wanted.

    Yields:
        Tables of the declared types, of 65,536 rows at most.
    """
    for table in _decode(file, path, schema, None, _BATCH_ROWS):
        yield _as_declared(table, path, schema, Counter())


def _decode(
    file: pq.ParquetFile,
    path: AnyFile,
    schema: pa.Schema,
    row_groups: Sequence[int] | None,
    batch_rows: int,
) -> Iterator[pa.Table]:
    """Yield the columns as Arrow decodes them; no batch spans two row groups.

    Arrow cannot join the dictionaries of two row groups inside a list.
    """
    for field in schema:
        problem = column_problem(file.schema_arrow, field)
        if problem is not None:
            raise FileRefusedError(
                problem[0], problem[1], path=path, where=field.name, found=file.schema_arrow.names
            )
    delta: dict[int, list[ColumnChunk]] = {}
    for chunk in read_column_chunks(path):
        if chunk.has_delta_text and chunk.path[0] in schema.names:
            delta.setdefault(chunk.row_group, []).append(chunk)
    groups = range(file.num_row_groups) if row_groups is None else row_groups
    for group in groups:
        rows = _rows_at_once(delta.get(group, []), batch_rows, path)
        try:
            for batch in file.iter_batches(
                rows, row_groups=[group], columns=schema.names, use_threads=False
            ):
                batch.validate(full=True)
                yield pa.Table.from_batches([batch])
        except FileRefusedError:
            raise
        except Exception as error:  # Arrow's errors do not share a base
            raise unreadable(path, error) from error


def _rows_at_once(delta: list[ColumnChunk], batch_rows: int, path: AnyFile) -> int:
    """Return how many rows of a row group to decode at a time, for bounded memory.

    A value of text in a delta encoding is no longer than its whole chunk, but each may be
    nearly as long. Inside a list the rows do not bound the number of values.
    """
    for chunk in delta:
        size = max(chunk.uncompressed_bytes, 1)
        if len(chunk.path) == 1:
            batch_rows = min(batch_rows, max(1, limits.MAX_TEXT_BYTES // size))
        elif chunk.values * size > limits.MAX_TEXT_BYTES:
            raise FileRefusedError(
                "FILE_TOO_LARGE",
                "text inside a list, in a delta encoding, may expand to more than allowed",
                path=path,
                where=".".join(chunk.path),
                found=f"{chunk.values} values in {size} bytes",
                required=f"values times bytes at most {limits.MAX_TEXT_BYTES}",
                fix="Write it with a dictionary or in plain encoding, or in smaller row groups.",
            )
    return batch_rows


def _as_declared(
    table: pa.Table, path: AnyFile, schema: pa.Schema, sizes: Counter[str]
) -> pa.Table:
    """Return a decoded batch in the declared types; `sizes` sums the bytes of text by column."""
    columns = []
    for field in schema:
        column = table.column(field.name)
        sizes[field.name] += sum(_text_bytes(chunk) for chunk in column.chunks)
        if sizes[field.name] > limits.MAX_TEXT_BYTES:
            raise FileRefusedError(
                "FILE_TOO_LARGE",
                "the text of a column is longer than allowed",
                path=path,
                where=field.name,
                found=f"{sizes[field.name]} bytes",
                required=f"at most {limits.MAX_TEXT_BYTES}",
            )
        try:
            chunks = [_converted(chunk, field.type) for chunk in column.chunks]
        except Exception as error:
            raise unreadable(path, error) from error
        nulls = sum(_null_count(chunk) for chunk in chunks)
        if not field.nullable and nulls:
            raise FileRefusedError(
                "VALUE_NULL",
                "null is not allowed",
                path=path,
                where=field.name,
                found=f"{nulls} nulls",
            )
        columns.append(pa.chunked_array(chunks, field.type))
    return pa.Table.from_arrays(columns, schema=schema)


def _converted(array: pa.Array, kind: pa.DataType) -> pa.Array:
    """Return an array in a declared type; nulls stay, wherever they are."""
    if pa.types.is_dictionary(array.type):
        array = array.dictionary_decode()
    if array.type == kind:
        return array
    if pa.types.is_list(kind):
        lengths = pc.list_value_length(array).fill_null(0).to_numpy(zero_copy_only=False)
        offsets = pa.array(np.concatenate([[0], np.cumsum(lengths)]), pa.int32())
        inner = _converted(array.flatten(), kind.value_type)
        mask = array.is_null() if array.null_count else None
        return pa.ListArray.from_arrays(offsets, inner, type=kind, mask=mask)
    if pa.types.is_struct(kind):
        parts = dict(zip((field.name for field in array.type), array.flatten(), strict=True))
        inner = [_converted(parts[field.name], field.type) for field in kind]
        mask = array.is_null() if array.null_count else None
        return pa.StructArray.from_arrays(inner, fields=list(kind), mask=mask)
    return array.cast(kind)


def _null_count(array: pa.Array) -> int:
    """Count the nulls of an array of a declared type and of what its lists and structs contain."""
    count: int = array.null_count
    if pa.types.is_list(array.type):
        count += _null_count(array.flatten())
    elif pa.types.is_struct(array.type):
        count += sum(_null_count(child) for child in array.flatten())
    return count


def _text_bytes(array: pa.Array) -> int:
    """Return the bytes of an array's text, written out."""
    if pa.types.is_dictionary(array.type):
        if not _is_text(array.type.value_type):
            return 0
        lengths = _lengths(array.dictionary)
        return int(pc.sum(lengths.take(array.indices)).as_py() or 0)
    if _is_list(array.type):
        return _text_bytes(array.flatten())
    if pa.types.is_struct(array.type):
        return sum(_text_bytes(child) for child in array.flatten())
    return int(pc.sum(_lengths(array)).as_py() or 0) if _is_text(array.type) else 0


def _lengths(text: pa.Array) -> pa.Array:
    if text.type == pa.string_view():
        text = text.cast(pa.large_string())
    return pc.binary_length(text).cast(pa.int64())


def stacked(table: pa.Table, *names: str) -> npt.NDArray[Any]:
    """Return numeric columns of a table next to each other, (N, K), in their common type."""
    return np.stack([table.column(name).to_numpy() for name in names], axis=1)


def codes(column: pa.ChunkedArray | pa.Array, known: Sequence[str]) -> npt.NDArray[np.int32]:
    """Return the position of each text of a column in a list, int32 (N,); -1 where it is not there.

    Args:
        column: Texts, plain or as dictionaries, without nulls.
        known: The list, without repetitions.
    """
    found: npt.NDArray[np.int32] = np.empty(len(column), np.int32)
    start = 0
    for chunk in column.chunks if isinstance(column, pa.ChunkedArray) else [column]:
        encoded = chunk if pa.types.is_dictionary(chunk.type) else chunk.dictionary_encode()
        place = pc.fill_null(pc.index_in(encoded.dictionary, pa.array(known, pa.string())), -1)
        found[start : start + len(chunk)] = place.take(encoded.indices).to_numpy(False)
        start += len(chunk)
    return found


def column_problem(schema: pa.Schema, field: pa.Field) -> tuple[str, str] | None:
    """Say what is wrong with a file's column, or None.

    Args:
        schema: The file's Arrow schema.
        field: The declared field.

    Returns:
        (issue code, sentence), or None if the column is there with the declared type.
    """
    count = schema.names.count(field.name)
    if count == 0:
        return "COLUMN_MISSING", f"the column {field.name} is missing"
    if count > 1:
        return "COLUMN_EXTRA", f"the column {field.name} is there {count} times"
    found = schema.field(field.name).type
    if not _same_type(found, field.type):
        return "COLUMN_TYPE", f"the column {field.name} is {found}; required: {field.type}"
    return None


def _same_type(found: pa.DataType, declared: pa.DataType) -> bool:
    if pa.types.is_dictionary(found):
        found = found.value_type
    if pa.types.is_string(declared):
        return _is_text(found)
    if pa.types.is_list(declared):
        return _is_list(found) and _same_type(found.value_type, declared.value_type)
    if pa.types.is_struct(declared):
        if not pa.types.is_struct(found):
            return False
        parts = {field.name: field.type for field in found}
        return sorted(field.name for field in found) == sorted(
            field.name for field in declared
        ) and all(_same_type(parts[field.name], field.type) for field in declared)
    return bool(found == declared)


def _is_text(kind: pa.DataType) -> bool:
    return kind in (pa.string(), pa.large_string(), pa.string_view())


def _is_list(kind: pa.DataType) -> bool:
    return isinstance(
        kind,
        pa.ListType
        | pa.LargeListType
        | pa.FixedSizeListType
        | pa.ListViewType
        | pa.LargeListViewType,
    )


def rows_in_order(table: pa.Table, frames: range, path: AnyFile) -> pa.Table:
    """Return the correspondences of some frames if they are ascending by frame, then point."""
    count = table.num_rows // len(frames)
    expected = np.repeat(frames, count), np.tile(np.arange(count), len(frames))
    found = table["frame"].to_numpy(), table["point"].to_numpy()
    wrong = (found[0] != expected[0]) | (found[1] != expected[1])
    if wrong.any():
        row = int(wrong.argmax())
        raise FileRefusedError(
            "ROW_ORDER",
            "the rows must be ascending by frame, then point",
            path=path,
            where=f"row {frames.start * count + row}",
            found=f"frame {found[0][row]}, point {found[1][row]}",
            required=f"frame {expected[0][row]}, point {expected[1][row]}",
        )
    return table
