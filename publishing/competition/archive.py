"""Zip archives whose bytes depend on their contents alone."""

from __future__ import annotations

import io
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, Final

_FIRST_DAY: Final = (1980, 1, 1, 0, 0, 0)

Members = Mapping[str, bytes | Path]
"""Name inside the archive -> its bytes, or the file that contains them."""


def write_archive(target: Path | BinaryIO, members: Members) -> None:
    """Write an archive: names sorted, no dates, and stored, so that no zlib has a say.

    What is large in a dataset (Parquet, EXR, PNG) is compressed already.

    Args:
        target: The archive to write, or an open file.
        members: What it contains.
    """
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(members):
            content = members[name]
            info = zipfile.ZipInfo(name, _FIRST_DAY)
            info.create_system = 3  # Unix, wherever it is written
            info.external_attr = 0o644 << 16
            if isinstance(content, bytes):
                archive.writestr(info, content)
                continue
            info.file_size = content.stat().st_size
            with archive.open(info, "w") as member, content.open("rb") as source:
                shutil.copyfileobj(source, member, 1 << 20)


def archive_bytes(members: Members) -> bytes:
    """Return a small archive as bytes; see `write_archive`."""
    buffer = io.BytesIO()
    write_archive(buffer, members)
    return buffer.getvalue()
