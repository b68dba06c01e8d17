"""How large a file may be, checked before its contents are read.

The limits hold for every conforming dataset, so that a reader can refuse a hostile file
before it takes any memory. They are in SPEC.md.
"""

from __future__ import annotations

from typing import Final

MAX_JSON_BYTES: Final = 16 * 2**20
MAX_JSON_DEPTH: Final = 64
MAX_YAML_BYTES: Final = 2**18
MAX_YAML_DEPTH: Final = 64
MAX_YAML_VALUES: Final = 50_000
MAX_FOOTER_BYTES: Final = 2**20
MAX_IMAGE_SIDE_PX: Final = 8192
MAX_IMAGE_PIXELS: Final = 2**24
MAX_IMAGE_FILE_BYTES: Final = 512 * 2**20
MAX_FRAMES: Final = 100_000
MAX_POINTS: Final = 1_000_000
MAX_TABLE_ROWS: Final = 50_000_000
MAX_TABLE_BYTES: Final = 4 * 2**30
MAX_CORRESPONDENCE_ROWS: Final = 20_000_000
MAX_SEQUENCES: Final = 1_000_000
MAX_NAME_LENGTH: Final = 128
MAX_FOOTER_ONLY_ROWS: Final = 2**40
MAX_CHUNK_BYTES: Final = 2**28
MAX_CHUNK_VALUES: Final = 2**26
MAX_TEXT_BYTES: Final = 2**31 - 1


def max_file_bytes(name: str) -> int:
    """Return how large a table or an image of a sequence may be."""
    return MAX_TABLE_BYTES if name.endswith(".parquet") else MAX_IMAGE_FILE_BYTES
