"""Reads the column-chunk metadata of a Parquet footer in plain Python.

pyarrow can read the same (`metadata.row_group(i).column(j)`), but where a footer contradicts
itself that call ends the whole process with an uncaught C++ exception, so it must not see a file
that nobody has vouched for. The footer is Thrift's compact protocol; only the few fields needed
are kept, the rest is skipped.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, Final

from pliant.spec.io.reading import AnyFile, FileRefusedError, open_binary

MAX_FOOTER_BYTES: Final = 16 * 2**20
_TAIL_BYTES: Final = 8
_DELTA_TEXT: Final = frozenset({6, 7})
_BYTE_ARRAY: Final = 6  # of the format's physical types
_MAX_DEPTH: Final = 32

# Types of the compact protocol.
_TRUE, _FALSE, _BYTE, _DOUBLE, _BINARY = 1, 2, 3, 7, 8
_INTEGERS: Final = (4, 5, 6)
_LISTS: Final = (9, 10)
_MAP, _STRUCT = 11, 12


@dataclass(frozen=True)
class ColumnChunk:
    """One leaf column in one row group, as the footer announces it.

    Attributes:
        row_group: Index of the row group.
        path: Names from the top-level column to the leaf.
        values: Values of the chunk, nulls included.
        uncompressed_bytes: Size of its pages once decompressed.
        is_text: Whether its values are byte arrays of any length.
        encodings: Numbers of its pages' encodings in the Parquet format.
    """

    row_group: int
    path: tuple[str, ...]
    values: int
    uncompressed_bytes: int
    is_text: bool
    encodings: tuple[int, ...]

    @property
    def has_delta_text(self) -> bool:
        """Whether a page is in DELTA_LENGTH_BYTE_ARRAY or DELTA_BYTE_ARRAY."""
        return not _DELTA_TEXT.isdisjoint(self.encodings)


def read_column_chunks(path: AnyFile) -> list[ColumnChunk]:
    """Return the column chunks of a Parquet file, row group by row group.

    Args:
        path: The file.

    Raises:
        FileRefusedError: It has no footer that can be read, or one that is too large.
    """
    try:
        with open_binary(path) as stream:
            size = stream.seek(0, 2)
            stream.seek(max(0, size - _TAIL_BYTES))
            tail = stream.read(_TAIL_BYTES)
            length = int.from_bytes(tail[:4], "little")
            if len(tail) < _TAIL_BYTES or tail[4:] != b"PAR1" or length > size - _TAIL_BYTES:
                raise unreadable(path, "no Parquet footer")
            if length > MAX_FOOTER_BYTES:
                raise FileRefusedError(
                    "FILE_TOO_LARGE",
                    "the Parquet footer is larger than allowed",
                    path=path,
                    found=f"{length} bytes",
                    required=f"at most {MAX_FOOTER_BYTES}",
                    fix="Write larger row groups.",
                )
            stream.seek(size - _TAIL_BYTES - length)
            footer = stream.read(length)
    except OSError as error:
        raise unreadable(path, error.strerror) from error
    try:
        return list(_column_chunks(footer))
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise unreadable(path, f"a footer that is not a Thrift structure: {error}") from error


# Field number -> how to read it: None keeps the value, a mapping keeps a structure's fields.
_META_DATA: Final[dict[int, Any]] = {1: None, 2: None, 3: None, 5: None, 6: None}
_ROW_GROUP: Final[dict[int, Any]] = {1: {3: _META_DATA}}
_FILE: Final[dict[int, Any]] = {4: _ROW_GROUP}


@functools.lru_cache(maxsize=4)  # one reading of a table opens its file several times
def _column_chunks(footer: bytes) -> tuple[ColumnChunk, ...]:
    document = _Reader(footer).structure(_FILE, 0)
    result = []
    for index, group in enumerate(document.get(4, [])):
        for column in group[1]:
            meta = column[3]
            path = tuple(part.decode("utf-8") for part in meta[3])
            result.append(
                ColumnChunk(
                    index,
                    path,
                    values=int(meta[5]),
                    uncompressed_bytes=int(meta[6]),
                    is_text=meta[1] == _BYTE_ARRAY,
                    encodings=tuple(int(number) for number in meta[2]),
                )
            )
    return tuple(result)


class _Reader:
    """Reads Thrift's compact protocol from bytes; anything malformed is a ValueError or worse."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def structure(self, wanted: dict[int, Any] | None, depth: int) -> dict[int, Any]:
        """Read a structure; keep the wanted fields, skip the others."""
        if depth > _MAX_DEPTH:
            raise ValueError("too deep")
        found: dict[int, Any] = {}
        number = 0
        while True:
            head = self._data[self._at]
            self._at += 1
            if head == 0:
                return found
            kind = head & 15
            step = head >> 4
            number = number + step if step else self._zigzag()
            if kind in (_TRUE, _FALSE):
                continue
            if wanted is not None and number in wanted:
                found[number] = self._value(kind, wanted[number], True, depth)
            else:
                self._value(kind, None, False, depth)

    def _value(self, kind: int, inner: Any, keep: bool, depth: int) -> Any:
        if kind in _INTEGERS:
            return self._zigzag()
        if kind == _BINARY:
            length = self._varint()
            begin = self._skip(length)
            return self._data[begin : begin + length] if keep else None
        if kind == _STRUCT:
            return self.structure(inner, depth + 1)
        if kind in _LISTS:
            return self._list(inner, keep, depth)
        if kind in (_BYTE, _TRUE, _FALSE):
            return self._byte()  # inside a list a boolean takes a byte
        if kind == _DOUBLE:
            return self._skip(8)
        if kind == _MAP:
            count = self._varint()
            kinds = self._byte() if count else 0
            for _ in range(count):
                self._value(kinds >> 4, None, False, depth + 1)
                self._value(kinds & 15, None, False, depth + 1)
            return None
        raise ValueError(f"unknown type {kind}")

    def _list(self, inner: Any, keep: bool, depth: int) -> list[Any]:
        head = self._byte()
        count = head >> 4
        if count == 15:
            count = self._varint()
        if count > len(self._data) - self._at:  # every element takes a byte at least
            raise ValueError("a list longer than the footer")
        values = [self._value(head & 15, inner, keep, depth + 1) for _ in range(count)]
        return values if keep else []

    def _byte(self) -> int:
        value = self._data[self._at]
        self._at += 1
        return value

    def _varint(self) -> int:
        byte = self._data[self._at]
        self._at += 1
        if byte < 128:  # most of them
            return byte
        value, shift = byte & 127, 7
        while byte >= 128:
            if shift > 63:
                raise ValueError("an integer of more than 64 bits")
            byte = self._byte()
            value |= (byte & 127) << shift
            shift += 7
        return value

    def _zigzag(self) -> int:
        value = self._varint()
        return (value >> 1) ^ -(value & 1)

    def _skip(self, length: int) -> int:
        begin = self._at
        if length > len(self._data) - begin:
            raise ValueError("a text longer than the footer")
        self._at += length
        return begin


def unreadable(path: AnyFile, found: object) -> FileRefusedError:
    """Return the error of a Parquet file that cannot be decoded."""
    text = " ".join(str(found).split())[:300]
    return FileRefusedError(
        "FILE_UNREADABLE", "the Parquet file cannot be decoded", path=path, found=text
    )
