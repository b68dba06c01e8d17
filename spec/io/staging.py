"""The one way an output folder is written: whole, or not at all."""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from pliant.spec.errors import CallError
from pliant.spec.io.writing import abandoned, other_place, synced

_HERE: Final = -100
_EXCHANGE: Final = 2
"""AT_FDCWD and RENAME_EXCHANGE of Linux."""


@contextmanager
def staged(folder: Path, *, new: bool = False) -> Iterator[Path]:
    """Give an empty folder next to `folder`, and rename it to `folder` at the end.

    When the body raises, the folder is removed and `folder` stays as it was. All data is on the
    disk before the folder is renamed. What a killed process left next to `folder` is removed at
    the start.

    Args:
        folder: The folder to write; an earlier one is replaced.
        new: Replace only an empty folder, also where another process fills it in the meantime.

    Raises:
        CallError: The folder cannot be written: no space, no permission (also where an earlier
            one is read-only), or there is one; or the body cannot read a file.
    """
    folder = folder.resolve()
    if new:
        refuse_existing(folder)
    _tidy(folder)
    made = folder.with_name(f".{folder.name}.{os.getpid()}.partial")
    earlier = folder.with_name(f".{folder.name}.{os.getpid()}.earlier")
    try:
        if folder.exists() and not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        folder.parent.mkdir(parents=True, exist_ok=True)
        made.mkdir()
        yield made
        for path in [*made.rglob("*"), made]:
            synced(path)
        if new:
            _rename_to_new(made, folder)
        elif not (folder.exists() and _exchanged(made, folder)):
            if folder.exists():
                folder.rename(earlier)
            made.rename(folder)
        synced(folder.parent)
    except OSError as error:
        found, place = error.strerror or str(error), error.filename
        if (
            isinstance(place, str)
            and not Path(place).is_relative_to(made)
            and os.path.isfile(place)
        ):
            raise CallError("the file cannot be read", path=place, found=found) from error
        raise CallError(
            "the folder cannot be written",
            path=folder,
            found=found,
            fix=f"{other_place(error)}; an earlier folder there is unchanged.",
        ) from error
    finally:
        if earlier.exists() and not folder.exists():
            earlier.rename(folder)
        for each in (made, earlier):
            discard(each)


@contextmanager
def staged_both(folder: Path, other: Path) -> Iterator[tuple[Path, Path]]:
    """Stage two new folders that belong together; `other` gets its name first.

    After an error there is neither. A process that is killed between the two renames leaves
    `other` alone, which `is_left_alone` recognises and the next staging replaces.

    Raises:
        CallError: A folder cannot be written or exists, or one is the other or inside it.
    """
    places = folder.resolve(), other.resolve()
    if any(place.is_relative_to(outer) for place, outer in (places, places[::-1])):
        raise CallError(
            "of two output folders, one is inside the other",
            path=other,
            found=folder,
            fix="Name a folder next to it.",
        )
    if is_left_alone(other, folder):
        discard(other)
    own = None
    try:
        with staged(folder, new=True) as one, staged(other, new=True) as two:
            own = two.stat().st_ino
            yield one, two
    except BaseException:
        if not folder.exists() and other.exists() and other.stat().st_ino == own:
            discard(other)
        raise


def next_to(folder: Path, ending: str) -> Path:
    """Return the folder next to another that has its name and an ending, also for `.` and `..`."""
    named = folder if folder.name not in ("", "..") else folder.resolve()
    return named.parent / f"{named.name}{ending}"


def refuse_existing(folder: Path) -> None:
    """Refuse an output that exists, except as an empty folder.

    Raises:
        CallError: There is such an output.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise CallError(
            "the output exists already", path=folder, fix="Name a new or an empty folder."
        )


def discard(folder: Path) -> None:
    """Remove a folder with all that is in it; what cannot be removed at the second try stays."""
    shutil.rmtree(folder, ignore_errors=True)
    if folder.exists():
        shutil.rmtree(folder, ignore_errors=True)


def is_left_alone(other: Path, folder: Path) -> bool:
    """Return whether a killed process had finished `other` of two folders, and not `folder`."""
    unfinished = abandoned(folder.parent, f".{folder.name}.", ".partial")
    return other.exists() and not folder.exists() and bool(unfinished)


def _rename_to_new(made: Path, folder: Path) -> None:
    """Rename a folder; the system refuses it where `folder` has become one with files in it."""
    with suppress(OSError):
        folder.rmdir()  # an empty one
    try:
        made.rename(folder)
    except OSError:
        refuse_existing(folder)
        raise


def _exchanged(one: Path, other: Path) -> bool:
    """Give two folders each other's name at one moment; return False where that is not possible.

    Without it there is a moment at which the folder has no name.
    """
    if sys.platform != "linux":
        return False
    call = getattr(ctypes.CDLL(None), "renameat2", None)
    if call is None:
        return False
    result: int = call(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE)
    return result == 0


def _tidy(folder: Path) -> None:
    """Remove what processes that ended left of an earlier writing of a folder."""
    for path in abandoned(folder.parent, f".{folder.name}.", ".earlier"):
        if not folder.exists():
            path.rename(folder)
        discard(path)
    for path in abandoned(folder.parent, f".{folder.name}.", ".partial"):
        discard(path)
