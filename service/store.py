"""Submission files under their sha256; each is written once and never changed."""

from __future__ import annotations

import os
import shutil
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
        """Store a file durably; one that is there already stays."""
        place = self.path(sha256)
        if place.exists():
            return
        place.parent.mkdir(parents=True, exist_ok=True)
        partial = place.with_name(f".{place.name}.{os.getpid()}-{os.urandom(4).hex()}")
        try:
            shutil.copyfile(file, partial)
            synced(partial)
            partial.replace(place)
            synced(place.parent)
        finally:
            partial.unlink(missing_ok=True)

    def remove(self, sha256: str) -> None:
        """Remove a file that no submission names."""
        self.path(sha256).unlink(missing_ok=True)

    def path(self, sha256: str) -> Path:
        """Return where a file is, or would be."""
        return self._root / sha256[:2] / f"{sha256}.parquet"
