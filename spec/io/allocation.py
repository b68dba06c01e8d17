"""Room on the disk for files that are mapped into memory."""

from __future__ import annotations

import os
from pathlib import Path

from pliant.spec.errors import PliantError


def allocate(path: Path, size: int, what: str) -> None:
    """Make a file at least so long, all of it on the disk.

    Writing to a mapped part that the disk has no room for ends the process with SIGBUS.

    Args:
        path: The file; what it contains stays.
        size: Bytes.
        what: What the file is, for the message.

    Raises:
        PliantError: There is no room, or the file cannot be written.
    """
    new = not path.exists()
    try:
        with open(path, "ab") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
            else:  # macOS
                file.write(bytes(max(0, size - path.stat().st_size)))
    except OSError as error:
        if new:
            path.unlink(missing_ok=True)
        raise PliantError(
            f"there is no room for {what} ({error.strerror})",
            path=path,
            required=f"{size:,} bytes",
            fix="Free disk space, or choose a folder on another disk.",
        ) from error
