"""The files of a packed dataset: Parquet shards, and the index of the files in them."""

from __future__ import annotations

import bisect
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.io import limits
from pliant.spec.io.parquet import open_table
from pliant.spec.io.parquet_columns import load_columns
from pliant.spec.io.reading import AnyFile, Blob, FileRefusedError
from pliant.spec.storage import layout
from pliant.spec.storage.files import Storage
from pliant.spec.tables import INDEX

_GROUPS_IN_MEMORY = 256
_ROWS_IN_MEMORY = 1024


class PackedFiles:
    """A dataset whose sequences are in shards; `index.parquet` says where.

    Args:
        storage: Where the dataset is.
        sequence_ids: The ids of sequences.parquet, in order: row i of the index is row i of it.
    """

    def __init__(self, storage: Storage, sequence_ids: Sequence[str]) -> None:
        self._storage, self.address = storage, storage.address
        self._ids = list(sequence_ids)
        self._row_of = {name: row for row, name in enumerate(self._ids)}
        self._index: tuple[pq.ParquetFile, list[int]] | None = None
        self._group = lru_cache(_GROUPS_IN_MEMORY)(self._read_group)
        self._members = lru_cache(_ROWS_IN_MEMORY)(self._read_members)

    def __reduce__(self) -> tuple[type[PackedFiles], tuple[Storage, list[str]]]:
        """Leave out what another process reads again soon enough."""
        return PackedFiles, (self._storage, self._ids)

    def has(self, name: str) -> bool:
        """Return whether there is such a file, packed or loose."""
        if (parts := _split(name)) is not None:
            return parts[1] in self.members(parts[0])
        return self._storage.has(name)

    def get(self, name: str) -> AnyFile:
        """Return a file: the bytes of a packed one, else what the storage gives."""
        parts = _split(name)
        if parts is None:
            return self._storage.get(name)
        shown = f"{self.address}/{name}"
        member = self.members(parts[0]).get(parts[1])
        if member is None:
            raise FileRefusedError("FILE_MISSING", "the file is not there", path=shown)
        shard, offset, count = member
        limit = limits.max_file_bytes(name)
        if not 0 <= count <= limit or offset < 0 or not layout.is_shard_name(shard):
            raise FileRefusedError(
                "INDEX_INVALID",
                "the index points outside its shard",
                path=f"{self.address}/{layout.INDEX_TABLE}",
                where=name,
                found=f"{count} bytes from {offset} of {shard!r:.80}",
            )
        return Blob(shown, self._storage.read_range(shard, offset, count))

    def local(self, name: str) -> Path:
        """Return a file that is not packed as one on this machine."""
        return self._storage.local(name)

    def members(self, sequence_id: str) -> Mapping[str, Member]:
        """Return the files of a sequence: path in its folder -> (shard, offset, bytes).

        Raises:
            FileRefusedError: The index is missing, damaged, or lists other sequences.
        """
        row = self._row_of.get(sequence_id)
        return {} if row is None else self._members(row)

    def _read_members(self, row: int) -> dict[str, Member]:
        path = self._storage.local(layout.INDEX_TABLE)
        if self._index is None:
            file = open_table(path, max_rows=limits.MAX_SEQUENCES)
            counts = [file.metadata.row_group(g).num_rows for g in range(file.num_row_groups)]
            self._index = (file, list(accumulate(counts, initial=0)))
        starts = self._index[1]
        group = bisect.bisect_right(starts, row) - 1
        listed = None
        if group < len(starts) - 1:
            entry = self._group(group).slice(row - starts[group], 1).to_pylist()[0]
            listed = entry["id"]
        if listed != self._ids[row]:
            raise FileRefusedError(
                "INDEX_INVALID",
                "the index does not list the sequences of sequences.parquet in order",
                path=f"{self.address}/{layout.INDEX_TABLE}",
                where=f"row {row}",
                found=listed,
                required=self._ids[row],
            )
        return members_of(entry)

    def _read_group(self, group: int) -> pa.Table:
        assert self._index is not None
        path = self._storage.local(layout.INDEX_TABLE)
        return load_columns(self._index[0], path, INDEX, [group])


Member = tuple[str, int, int]
"""Where a packed file is: shard, offset, bytes."""


def members_of(row: Mapping[str, Any]) -> dict[str, Member]:
    """Return the files of one row of the index."""
    return {f["path"]: (f["shard"], f["offset"], f["bytes"]) for f in row["files"]}


def _split(name: str) -> tuple[str, str] | None:
    """Return (sequence id, path in its folder) of a name below `sequences/`, else None."""
    parts = name.split("/", 3)
    return (parts[2], parts[3]) if len(parts) == 4 and parts[0] == layout.SEQUENCES_DIR else None
