"""Submission files under their sha256: in a folder, or at any fsspec URL."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from pliant.spec.errors import MissingExtraError
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
        place = self._root / _name(sha256)
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

    def has(self, sha256: str) -> bool:
        """Return whether the store contains a file."""
        return (self._root / _name(sha256)).is_file()

    @contextmanager
    def local(self, sha256: str) -> Iterator[Path]:
        """Give a path on this machine to read a file from."""
        yield self._root / _name(sha256)


class RemoteStore:
    """Any place that fsspec can write to, such as `s3://bucket/folder`.

    Args:
        url: The place.
        scratch: Folder on this machine for files while they are read.
    """

    def __init__(self, url: str, scratch: Path) -> None:
        try:
            import fsspec
        except ImportError as error:
            raise MissingExtraError("A store at a URL", "publish") from error
        self._files, self._root = fsspec.core.url_to_fs(url)
        self._scratch = scratch

    def put(self, file: Path, sha256: str) -> None:
        """Store a file; one that is there already stays."""
        if not self.has(sha256):
            place = f"{self._root}/{_name(sha256)}"
            self._files.makedirs(place.rpartition("/")[0], exist_ok=True)
            partial = f"{place}.{os.urandom(4).hex()}"
            self._files.put_file(str(file), partial)
            self._files.mv(partial, place)

    def has(self, sha256: str) -> bool:
        """Return whether the store contains a file."""
        return bool(self._files.exists(f"{self._root}/{_name(sha256)}"))

    @contextmanager
    def local(self, sha256: str) -> Iterator[Path]:
        """Fetch a file for as long as it is read."""
        self._scratch.mkdir(exist_ok=True)
        path = self._scratch / f"{sha256}-{os.urandom(4).hex()}.parquet"
        try:
            self._files.get_file(f"{self._root}/{_name(sha256)}", str(path))
            yield path
        finally:
            path.unlink(missing_ok=True)


Store = FolderStore | RemoteStore
"""Where submission files are kept; a file is written once and never changed."""


def open_store(place: str, default: Path, scratch: Path) -> Store:
    """Return the store that `challenge.yaml` names.

    Args:
        place: A folder, an fsspec URL, or empty.
        default: The folder that empty means.
        scratch: Folder for files that are fetched.
    """
    if len(urlsplit(place).scheme) > 1:
        return RemoteStore(place, scratch)
    return FolderStore(Path(place) if place else default)


def _name(sha256: str) -> str:
    return f"{sha256[:2]}/{sha256}.parquet"
