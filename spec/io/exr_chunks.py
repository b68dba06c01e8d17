"""Whether the chunks of an EXR file are whole, found without the OpenEXR library.

The library keeps the memory of a picture that it fails to decode: 16 bytes a pixel each time.
"""

from __future__ import annotations

import struct
import zlib
from typing import Final

LINES: Final = {0: 1, 2: 1, 3: 16}
"""Compression -> lines in a chunk."""

_LEADER: Final = struct.Struct("<ii")


def check_chunks(
    data: bytes, start: int, compression: int, height: int, line_bytes: int, *, inflate: bool
) -> None:
    """Check that every chunk is where the table of offsets says, and of its size.

    Args:
        data: The file.
        start: Where the table of offsets begins: after the header.
        compression: EXR's compression number, a key of `LINES`.
        height: Lines of the picture.
        line_bytes: Bytes of a line of all channels, before compression.
        inflate: Whether to decompress the chunks as well, which takes twice the time of decoding.

    Raises:
        ValueError: A chunk is damaged.
    """
    lines = LINES[compression]
    count = -(-height // lines)
    if start + 8 * count > len(data):
        raise ValueError("the file ends in the table of chunks")
    for number, offset in enumerate(struct.unpack_from(f"<{count}Q", data, start)):
        where = f"chunk {number} of {count}"
        begin = offset + _LEADER.size
        if offset < start + 8 * count or begin > len(data):
            raise ValueError(f"{where} is not in the file")
        line, size = _LEADER.unpack_from(data, offset)
        required = min(lines, height - number * lines) * line_bytes
        if line != number * lines or not 0 < size <= required or begin + size > len(data):
            raise ValueError(f"{where} is damaged or not whole")
        if inflate and size < required:
            _check_inflates(memoryview(data)[begin : begin + size], required, where)


def _check_inflates(chunk: memoryview, required: int, where: str) -> None:
    stream = zlib.decompressobj()
    try:
        found = len(stream.decompress(chunk, required + 1))
    except zlib.error as error:
        raise ValueError(f"{where} cannot be decompressed") from error
    if found != required or not stream.eof or stream.unused_data:
        raise ValueError(f"{where} has another size than required")
