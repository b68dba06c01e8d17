"""The one way a file is written in place of another: whole, or not at all."""

from __future__ import annotations

import errno
import glob
import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pliant.spec.errors import CallError


@contextmanager
def replacing(path: Path | str, *, durable: bool = False) -> Iterator[Path]:
    """Give a temporary path in the same folder, and rename it to `path` at the end.

    When the body raises, the temporary file is removed and `path` stays as it was. What a killed
    process left of an earlier writing of `path` is removed.

    Args:
        path: The file to write; replaced if it exists.
        durable: Wait until the data is on the disk, so that a power cut cannot empty the file.

    Yields:
        The path to write to, with the same suffix.

    Raises:
        CallError: The file cannot be written: no space, a read-only folder, no permission.
    """
    path = Path(path)
    partial = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    for left in abandoned(path.parent, f".{path.stem}.", f".partial{path.suffix}"):
        with suppress(OSError):
            left.unlink()
    try:
        yield partial
        if durable:
            synced(partial)
        os.replace(partial, path)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        with suppress(OSError):  # what prevented the write prevents this as well
            partial.unlink(missing_ok=True)


def write_file(path: Path | str, content: bytes | str) -> None:
    """Write a file through `replacing`, text as UTF-8.

    Raises:
        CallError: It cannot be written.
    """
    with replacing(path) as partial:
        partial.write_bytes(content.encode() if isinstance(content, str) else content)


def abandoned(folder: Path, before: str, after: str) -> list[Path]:
    """Return the temporary files or folders of processes that have ended.

    Args:
        folder: Where they are.
        before: What their names have before the number of the process.
        after: What their names have after it.
    """
    found = []
    for path in folder.glob(f"{glob.escape(before)}*{glob.escape(after)}"):
        number = path.name[len(before) : len(path.name) - len(after)]
        if number.isdecimal() and not _runs(int(number)):
            found.append(path)
    return found


def _runs(process: int) -> bool:
    """Return whether a process with this id exists; True where it cannot be found out."""
    if sys.platform == "win32":  # where `os.kill` ends a process instead of asking for it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # of somebody else
        return True
    return True


def synced(path: Path) -> None:
    """Wait until a file's data, or a folder's list of names, is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def require_folder(folder: Path) -> None:
    """Refuse the folder of an output file before the file is computed.

    Raises:
        CallError: It is missing or cannot be written to.
    """
    if not folder.is_dir():
        raise CallError(
            "the output folder does not exist",
            path=folder,
            fix=f"Create it: mkdir -p {shlex.quote(str(folder))}",
        )
    if not os.access(folder, os.W_OK | os.X_OK):
        raise CallError("the output folder cannot be written to", path=folder)


def cannot_write(path: Path | str, error: OSError) -> CallError:
    """Return an operating system's error as one sentence."""
    return CallError(
        "the file cannot be written",
        path=path,
        found=error.strerror or " ".join(str(error).split())[:200],
        fix=f"{other_place(error)}; an earlier file there is unchanged.",
    )


def other_place(error: OSError) -> str:
    """Return what to do where nothing can be written; only a full disk asks for space."""
    full = error.errno in (None, errno.ENOSPC, errno.EDQUOT)
    return "Free some space or name another place" if full else "Name another place"
