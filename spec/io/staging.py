"""The one way an output folder is written: whole, or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pliant.spec.errors import CallError
from pliant.spec.io.writing import abandoned, synced


@contextmanager
def staged(folder: Path) -> Iterator[Path]:
    """Give an empty folder next to `folder`, and rename it to `folder` at the end.

    When the body raises, the folder is removed and `folder` stays as it was. All data is on the
    disk before the folder is renamed. What a killed process left next to `folder` is removed at
    the start.

    Args:
        folder: The folder to write; an earlier one is replaced.

    Raises:
        CallError: The folder cannot be written: no space, no permission.
    """
    folder = folder.resolve()
    _tidy(folder)
    made = folder.with_name(f".{folder.name}.{os.getpid()}.partial")
    earlier = folder.with_name(f".{folder.name}.{os.getpid()}.earlier")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        made.mkdir()
        yield made
        for path in [*made.rglob("*"), made]:
            synced(path)
        if folder.exists():
            folder.rename(earlier)
        made.rename(folder)
        synced(folder.parent)
    except OSError as error:
        raise CallError(
            "the folder cannot be written",
            path=folder,
            found=error.strerror or str(error),
            fix="Free some space or name another place; an earlier folder there is unchanged.",
        ) from error
    finally:
        if earlier.exists() and not folder.exists():
            earlier.rename(folder)
        for each in (made, earlier):
            shutil.rmtree(each, ignore_errors=True)


def _tidy(folder: Path) -> None:
    """Remove what processes that ended left of an earlier writing of a folder."""
    for path in abandoned(folder.parent, f".{folder.name}.", ".earlier"):
        if not folder.exists():
            path.rename(folder)
        shutil.rmtree(path, ignore_errors=True)
    for path in abandoned(folder.parent, f".{folder.name}.", ".partial"):
        shutil.rmtree(path, ignore_errors=True)
