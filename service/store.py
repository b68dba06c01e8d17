"""Submission files under their sha256; each is written once and never changed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pliant.spec.io.writing import synced


class FolderStore:
    """A folder, on this machine or shared by several.

    Args:
        root: The folder.
    """

    def __init__(self, root: Path) -> None:
        self._root = root

    def put(self, file: Path, sha256: str) -> None:
        """Store a copy of a file durably; one that is there already stays."""
        if not self.path(sha256).exists():
            with self.copied(file, sha256) as keep:
                keep()

    @contextmanager
    def copied(self, file: Path, sha256: str) -> Iterator[Callable[[], None]]:
        """Copy a file, and yield what puts the copy at its place; without that it is removed."""
        place = self.path(sha256)
        place.parent.mkdir(parents=True, exist_ok=True)
        partial = place.with_name(f".{place.name}.{os.getpid()}-{os.urandom(4).hex()}")

        def keep() -> None:
            partial.replace(place)
            synced(place.parent)

        try:
            shutil.copyfile(file, partial)
            synced(partial)
            yield keep
        finally:
            partial.unlink(missing_ok=True)

    def path(self, sha256: str) -> Path:
        """Return where a file is, or would be."""
        return self._root / sha256[:2] / f"{sha256}.parquet"
