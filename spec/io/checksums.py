"""Checksums of files."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from pliant.spec.errors import SpecError
from pliant.spec.io.reading import AnyFile, open_binary


def sha256_file(path: AnyFile) -> str:
    """Return the sha256 of a file's bytes as 64 lower-case hexadecimal digits.

    Args:
        path: The file.

    Raises:
        SpecError: The file cannot be read.
    """
    try:
        with open_binary(path) as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise SpecError("the file cannot be read", path=path, found=error.strerror) from error


def file_entry(folder: Path, name: str) -> dict[str, Any]:
    """Return the entry of a file in the `files` of a `sequence.json`.

    Args:
        folder: The sequence's folder.
        name: Path of the file in it.
    """
    path = folder / name
    return {"path": name, "sha256": sha256_file(path), "bytes": path.stat().st_size}
