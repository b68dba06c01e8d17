"""One Parquet shard: rows written group by group, and where in the file each blob came to be.

A blob column is stored plainly (no compression, no dictionary, no statistics), so the bytes of
each value are in the file as they are. Its reader needs no Parquet: an offset and a length do.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.conventions import FOOTER_KEY, SPEC_VERSION

_HEAD: Final = 64


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
        leaves = list(_leaves(schema))
        plain = [leaf for leaf in leaves if leaf not in blobs]
        self._stream = open(path, "wb+")  # noqa: SIM115 - closed by close()
        self._writer = pq.ParquetWriter(
            self._stream,
            self._schema,
            version="2.6",
            data_page_version="1.0",
            compression={leaf: "NONE" if leaf in blobs else "ZSTD" for leaf in leaves},
            compression_level=dict.fromkeys(plain, 3),
            use_dictionary=plain or False,
            write_statistics=plain or False,
        )

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._stream.tell()

    def write(self, table: pa.Table, blobs: Sequence[bytes] = ()) -> list[int]:
        """Append a row group.

        Args:
            table: Its rows.
            blobs: The values of its blob columns that are not null, column by column.

        Returns:
            Where in the file each of them begins.
        """
        begin = self._stream.tell()
        self._writer.write_table(table.cast(self._schema), row_group_size=max(table.num_rows, 1))
        self._stream.flush()
        self._stream.seek(begin)
        region = self._stream.read()
        offsets = []
        at = 0
        for blob in blobs:
            at = _find(region, struct.pack("<I", len(blob)), blob, at)
            offsets.append(begin + at)
            at += len(blob)
        return offsets

    def close(self) -> None:
        """Write the footer; the file is whole now."""
        self._writer.close()
        self._stream.close()

    def abandon(self) -> None:
        """Let go of a file that nobody will want."""
        self._stream.close()


def _find(region: bytes, length: bytes, blob: bytes, at: int) -> int:
    """Return where a blob that follows its length begins in a region, from a place on."""
    head = length + blob[:_HEAD]
    while (found := region.find(head, at)) >= 0:
        begin = found + len(length)
        if region[begin : begin + len(blob)] == blob:
            return begin
        at = found + 1
    raise RuntimeError("this Arrow stores a plain column in another way; the shard has no index")


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
