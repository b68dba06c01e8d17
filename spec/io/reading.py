"""The one way a file of a dataset is opened: regular files only, within a size limit.

Its checksum is read here too.
"""

from __future__ import annotations

import hashlib
import io
import os
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pliant.spec.errors import SpecError


@dataclass(frozen=True)
class Blob:
    """A file whose bytes are in memory: a member of a shard, or one fetched over the network.

    Every reader of this package takes one where it takes a path.

    Attributes:
        name: What messages call it.
        data: Its bytes.
    """

    name: str
    data: bytes = field(repr=False)

    def __str__(self) -> str:
        return self.name


AnyFile = Path | str | Blob
"""A file on this machine by its path, or its bytes."""


class FileRefusedError(SpecError):
    """A file that cannot be, or must not be, read.

    Args:
        code: The issue code a validator reports, a key of `ISSUE_CODES`.
        message: What is wrong; the other arguments are those of `PliantError`.
    """

    def __init__(self, code: str, message: str, **details: Any) -> None:
        self.code = code
        super().__init__(message, **details)


def check_regular(path: AnyFile, max_bytes: int) -> int:
    """Check that a path is a regular file (no link) within a limit; return its size in bytes.

    Args:
        path: The file.
        max_bytes: The largest size allowed.

    Raises:
        FileRefusedError: It is missing, a link, a special file, or too large.
    """
    if isinstance(path, Blob):
        check_size(path, len(path.data), max_bytes)
        return len(path.data)
    try:
        status = os.lstat(path)
    except (OSError, ValueError) as error:
        raise FileRefusedError("FILE_MISSING", "the file is not there", path=path) from error
    if not stat.S_ISREG(status.st_mode):
        raise FileRefusedError(
            "PATH_UNSAFE",
            "only regular files are read",
            path=path,
            found="a link" if stat.S_ISLNK(status.st_mode) else "a folder or a special file",
            fix="Replace it with the file itself.",
        )
    check_size(path, status.st_size, max_bytes)
    return status.st_size


def check_size(path: AnyFile, size: int, max_bytes: int) -> None:
    """Refuse a file of more bytes than allowed.

    Raises:
        FileRefusedError: It is too large.
    """
    if size > max_bytes:
        raise FileRefusedError(
            "FILE_TOO_LARGE",
            "the file is larger than the specification allows",
            path=path,
            found=f"{size} bytes",
            required=f"at most {max_bytes}",
        )


def open_binary(path: AnyFile) -> io.BytesIO | io.BufferedReader:
    """Open a file for reading; the caller has checked it, and closes it.

    Raises:
        OSError: It cannot be opened.
    """
    return io.BytesIO(path.data) if isinstance(path, Blob) else open(path, "rb")


def read_bytes(path: AnyFile, max_bytes: int) -> bytes:
    """Return a regular file's bytes.

    Args:
        path: The file.
        max_bytes: The largest size allowed.

    Raises:
        FileRefusedError: As `check_regular`, or the file cannot be read.
    """
    size = check_regular(path, max_bytes)
    if isinstance(path, Blob):
        return path.data
    try:
        with open(path, "rb") as stream:
            return stream.read(size)
    except OSError as error:
        raise FileRefusedError(
            "FILE_UNREADABLE", "the file cannot be read", path=path, found=error.strerror
        ) from error


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
