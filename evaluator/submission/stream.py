"""Reads the columns of a Parquet file front to back, so many rows at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.io.parquet import open_table
from pliant.spec.io.parquet_footer import unreadable
from pliant.spec.io.reading import FileRefusedError

BATCH_ROWS: Final = 1 << 17
"""Rows decoded at once; some megabytes a column."""


class ColumnStream:
    """A cursor over some columns of a Parquet file.

    Args:
        path: The file.
        columns: The columns to decode; the others are never touched.
        strings: Those of them that hold text; they arrive as dictionaries.

    Raises:
        FileRefusedError: The file is missing, damaged, too large, or lacks a column.
    """

    def __init__(self, path: Path, columns: Sequence[str], strings: Sequence[str] = ()) -> None:
        self._path = path
        metadata = open_table(path).metadata
        # Without pre_buffer what is read is also let go: else the whole file stays in memory.
        file = pq.ParquetFile(
            path, metadata=metadata, read_dictionary=list(strings), pre_buffer=False
        )
        absent = [name for name in columns if file.schema_arrow.names.count(name) != 1]
        if absent:
            raise FileRefusedError(
                "COLUMN_MISSING",
                "a column is not there exactly once",
                path=path,
                where=absent[0],
                found=file.schema_arrow.names,
            )
        self.rows: int = metadata.num_rows
        self._batches: Iterator[pa.RecordBatch] = file.iter_batches(
            BATCH_ROWS, columns=list(columns), use_threads=False
        )
        self._pending: list[pa.RecordBatch] = []
        self._pending_rows = 0

    def take(self, rows: int) -> pa.Table:
        """Return the next rows.

        Args:
            rows: How many; the file must have them left.

        Raises:
            FileRefusedError: The file is damaged, or ends before its footer says.
        """
        try:
            while self._pending_rows < rows:
                batch = next(self._batches)
                self._pending.append(batch)
                self._pending_rows += batch.num_rows
        except StopIteration:
            raise unreadable(self._path, "fewer rows than its footer announces") from None
        except (pa.ArrowException, OSError, ValueError, TypeError) as error:
            raise unreadable(self._path, error) from error
        taken: list[pa.RecordBatch] = []
        left = rows
        while left:
            batch = self._pending[0]
            if batch.num_rows <= left:
                taken.append(self._pending.pop(0))
                left -= batch.num_rows
            else:
                taken.append(batch.slice(0, left))
                self._pending[0] = batch.slice(left)
                left = 0
        self._pending_rows -= rows
        table = pa.Table.from_batches(taken)
        for name in table.column_names:
            if table[name].null_count:
                raise FileRefusedError(
                    "VALUE_NULL", "null is not allowed", path=self._path, where=name
                )
        return table


def numbers(column: pa.ChunkedArray, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return a numeric column without nulls as one array of `dtype`."""
    result = np.empty(len(column), dtype)
    start = 0
    for chunk in column.chunks:
        result[start : start + len(chunk)] = chunk.to_numpy(zero_copy_only=False)
        start += len(chunk)
    return result
