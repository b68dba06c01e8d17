"""One Parquet shard: rows written group by group, and where in the file its blobs are.

A blob column is stored plainly (no compression, no dictionary, no statistics), so the bytes of
each value are in the file as they are. Its reader needs no Parquet: an offset and a length do.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.conventions import FOOTER_KEY, SPEC_VERSION

_PAGE_BYTES: Final = 2**31 - 1
"""A column of a row group is one page: its values follow each other without a gap."""


class ShardWriter:
    """Writes one shard.

    Args:
        path: Where to; its folder is made.
        schema: Its columns.
        blobs: Leaves that hold files, as paths such as `image.bytes`, in the schema's order.
        footer: What the `pliant` footer object contains other than `spec_version`.
        metadata: Further footer entries, texts.
    """

    def __init__(
        self,
        path: Path,
        schema: pa.Schema,
        blobs: Sequence[str],
        footer: Mapping[str, Any],
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"spec_version": SPEC_VERSION, **footer}, sort_keys=True)
        entries: dict[bytes | str, str] = {FOOTER_KEY: text}
        entries.update(metadata or {})
        self._schema = schema.with_metadata(entries)
        self._blobs = tuple(blobs)
        leaves = list(_leaves(schema))
        plain = [leaf for leaf in leaves if leaf not in blobs]
        self._stream = open(path, "wb")  # noqa: SIM115 - closed by close()
        self._writer = pq.ParquetWriter(
            self._stream,
            self._schema,
            version="2.6",
            data_page_version="1.0",
            compression={leaf: "NONE" if leaf in blobs else "ZSTD" for leaf in leaves},
            compression_level=dict.fromkeys(plain, 3),
            use_dictionary=plain or False,
            write_statistics=plain or False,
            data_page_size=_PAGE_BYTES,
        )

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._stream.tell()

    def write(self, table: pa.Table) -> None:
        """Append a row group."""
        self._writer.write_table(table.cast(self._schema), row_group_size=max(table.num_rows, 1))
        self._stream.flush()

    def close(self) -> list[dict[str, int]]:
        """Write the footer; the file is whole now.

        Returns:
            Of every row group, where in the file each blob column ends, by its path. Its last
            value ends there; each value comes after its length, a 32-bit number.
        """
        self._writer.close()
        self._stream.close()
        ends = []
        metadata = pq.read_metadata(self.path)
        for group in map(metadata.row_group, range(metadata.num_row_groups)):
            chunks = [group.column(index) for index in range(group.num_columns)]
            ends.append(
                {
                    chunk.path_in_schema: chunk.data_page_offset + chunk.total_compressed_size
                    for chunk in chunks
                    if chunk.path_in_schema in self._blobs
                }
            )
        return ends

    def abandon(self) -> None:
        """Let go of a file that nobody will want."""
        self._stream.close()


def _leaves(schema: pa.Schema) -> list[str]:
    """Return the paths of the columns as Parquet names them."""
    found: list[str] = []

    def visit(path: str, kind: pa.DataType) -> None:
        if pa.types.is_struct(kind):
            for part in kind:
                visit(f"{path}.{part.name}", part.type)
        elif pa.types.is_list(kind):
            visit(f"{path}.list.element", kind.value_type)
        else:
            found.append(path)

    for column in schema:
        visit(column.name, column.type)
    return found
