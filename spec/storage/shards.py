"""Parquet shards of packed files: rows written group by group, and where in a shard each file is.

A column of files is stored plainly (no compression, no dictionary, no statistics), so the bytes of
each file are in the shard as they are. Its reader needs no Parquet: an offset and a length do.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.storage import layout

_GROUP_BYTES: Final = 32 * 2**20
_PAGE_BYTES: Final = 2**31 - 1
"""A column of a row group is one page: its values follow each other without a gap."""

_LENGTH_BYTES: Final = 4
"""Each value comes after its length."""


class PackedFile(NamedTuple):
    """A file inside a row: its column as Parquet names it, its sequence, path there and size."""

    column: str
    sequence: str
    path: str
    size: int


class Shards:
    """Writes the shards of one folder and split, one after another.

    Args:
        root: The packed dataset's folder.
        folder: Name of the shards' folder.
        split: Their split.
        schema: Their columns and footer.
        shard_bytes: About how large a shard becomes.
        places: Gets the place of each file in its shard, by sequence: entries of the index.
    """

    def __init__(
        self,
        root: Path,
        folder: str,
        split: str,
        schema: pa.Schema,
        shard_bytes: int,
        places: Mapping[str, list[dict[str, Any]]],
    ) -> None:
        self._root, self._folder, self._split, self._schema = root, folder, split, schema
        self._shard_bytes, self._places = shard_bytes, places
        self._number = 0
        self._stream: Any = None
        self._writer: pq.ParquetWriter | None = None
        self._waiting: list[tuple[pa.Table, list[PackedFile]]] = []  # for the next row group
        self._groups: list[list[PackedFile]] = []  # of the present shard

    def make_room(self, size: int) -> None:
        """Begin a new shard if this many bytes more would make the present one too large."""
        written = self._waiting_bytes() + (0 if self._stream is None else self._stream.tell())
        if written and written + size > self._shard_bytes:
            self.close()
            self._number += 1

    def add(self, rows: pa.Table, files: list[PackedFile]) -> None:
        """Append rows and the files in them, in the order of the rows."""
        if self._waiting and self._waiting_bytes() + rows.nbytes > _GROUP_BYTES:
            self._flush()
        self._waiting.append((rows, files))

    def _waiting_bytes(self) -> int:
        return sum(rows.nbytes for rows, _ in self._waiting)

    @property
    def _shard(self) -> str:
        return layout.shard_name(self._folder, self._split, self._number)

    def _flush(self) -> None:
        """Write what waits as one row group."""
        if not self._waiting:
            return
        if self._writer is None:
            path = self._root / self._shard
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = open(path, "wb")  # noqa: SIM115 - closed by close() or abandon()
            self._writer = _writer(self._stream, self._schema)
        rows = pa.concat_tables([rows for rows, _ in self._waiting]).combine_chunks()
        self._writer.write_table(rows.cast(self._schema), row_group_size=max(rows.num_rows, 1))
        self._stream.flush()
        self._groups.append([file for _, files in self._waiting for file in files])
        self._waiting = []

    def close(self) -> None:
        """Finish the present shard, and note where its files are."""
        self._flush()
        if self._writer is None:
            return
        self._writer.close()
        self._stream.close()
        metadata = pq.read_metadata(self._root / self._shard)
        for number, files in enumerate(self._groups):
            group = metadata.row_group(number)
            chunks = [group.column(index) for index in range(group.num_columns)]
            ends = {
                chunk.path_in_schema: chunk.data_page_offset + chunk.total_compressed_size
                for chunk in chunks
            }
            for file in reversed(files):  # the last value ends with its column
                offset = ends[file.column] - file.size
                ends[file.column] = offset - _LENGTH_BYTES
                place = {"path": file.path, "shard": self._shard, "offset": offset}
                self._places[file.sequence].append({**place, "bytes": file.size})
        self._groups, self._writer, self._stream = [], None, None

    def abandon(self) -> None:
        """Close a file that will not be used."""
        if self._stream is not None:
            self._stream.close()


def _writer(stream: Any, schema: pa.Schema) -> pq.ParquetWriter:
    sink = pa.BufferOutputStream()
    pq.write_table(schema.empty_table(), sink)
    leaves = pq.ParquetFile(pa.BufferReader(sink.getvalue())).schema
    columns = [leaves.column(index) for index in range(len(leaves))]
    # In these tables whatever is binary and no text is a file.
    plain = [
        c.path
        for c in columns
        if c.physical_type != "BYTE_ARRAY" or c.logical_type.type == "STRING"
    ]
    return pq.ParquetWriter(
        stream,
        schema,
        version="2.6",
        data_page_version="1.0",
        compression={c.path: "ZSTD" if c.path in plain else "NONE" for c in columns},
        compression_level=dict.fromkeys(plain, 3),
        use_dictionary=plain,
        write_statistics=plain,
        data_page_size=_PAGE_BYTES,
    )
