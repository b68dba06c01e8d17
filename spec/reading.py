"""The one way a file of a dataset is opened: regular files only, within a size limit."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from pliant.spec.errors import SpecError


class FileRefusedError(SpecError):
    """A file that cannot be, or must not be, read.

    Args:
        code: The issue code a validator reports, a key of `ISSUE_CODES`.
        message: What is wrong; the other arguments are those of `PliantError`.
    """

    def __init__(
        self,
        code: str,
        message: str,
        *,
        path: Path | str | None = None,
        where: str | None = None,
        found: object | None = None,
        required: object | None = None,
        fix: str | None = None,
    ) -> None:
        self.code = code
        super().__init__(message, path=path, where=where, found=found, required=required, fix=fix)


def check_regular(path: Path | str, max_bytes: int) -> int:
    """Check that a path is a regular file (no link) within a limit; return its size in bytes.

    Args:
        path: The file.
        max_bytes: The largest size allowed.

    Raises:
        FileRefusedError: It is missing, a link, a special file, or too large.
    """
    try:
        status = os.lstat(path)
    except (OSError, ValueError) as error:
        raise FileRefusedError("FILE_MISSING", "the file is not there", path=path) from error
    if not stat.S_ISREG(status.st_mode):
        raise FileRefusedError(
            "PATH_UNSAFE",
            "a dataset holds regular files only",
            path=path,
            found="a link" if stat.S_ISLNK(status.st_mode) else "a folder or a special file",
            fix="Put the file itself there.",
        )
    if status.st_size > max_bytes:
        raise FileRefusedError(
            "FILE_TOO_LARGE",
            "the file is larger than the specification allows",
            path=path,
            found=f"{status.st_size} bytes",
            required=f"at most {max_bytes}",
        )
    return status.st_size


def read_bytes(path: Path | str, max_bytes: int) -> bytes:
    """Return a regular file's bytes.

    Args:
        path: The file.
        max_bytes: The largest size allowed.

    Raises:
        FileRefusedError: As `check_regular`, or the file cannot be read.
    """
    size = check_regular(path, max_bytes)
    try:
        with open(path, "rb") as stream:
            return stream.read(size)
    except OSError as error:
        raise FileRefusedError(
            "FILE_UNREADABLE", "the file cannot be read", path=path, found=error.strerror
        ) from error
