"""Where the files of a dataset come from: a folder, a remote one, shards, or two halves together.

The one seam between reading and storage. `Dataset` and its sequences ask for a file by its name
in the layout (`sequences/TIER/ID/rgb/000000.png`); one of these says where its bytes are. None
shares a place in an open file, so they travel to worker processes and survive a fork.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from pliant.spec.errors import MissingExtraError, SpecError
from pliant.spec.io import limits
from pliant.spec.io.reading import AnyFile, Blob, FileRefusedError, check_size


class Files(Protocol):
    """The files of a dataset by name."""

    @property
    def address(self) -> str:
        """What opens the same dataset again: a path or a URL."""

    def has(self, name: str) -> bool:
        """Return whether there is such a file."""

    def get(self, name: str) -> AnyFile:
        """Return a file to be read, there or not: a reader says so."""

    def local(self, name: str) -> Path:
        """Return a file as one on this machine, fetched if need be."""


class Storage(Files, Protocol):
    """Files of which a part can be read alone."""

    def read_range(self, name: str, offset: int, count: int) -> bytes:
        """Return bytes [offset, offset + count) of a file.

        Raises:
            FileRefusedError: It is missing, cannot be read, or ends before.
        """


class LocalFiles:
    """The files of a folder.

    Args:
        root: The folder.
    """

    def __init__(self, root: Path) -> None:
        self.root, self.address = root, str(root)

    def has(self, name: str) -> bool:
        """Return whether there is such a file."""
        return os.path.isfile(f"{self.root}/{name}")

    def get(self, name: str) -> Path:
        """Return the file's path."""
        return self.root / name

    local = get

    def read_range(self, name: str, offset: int, count: int) -> bytes:
        """Return a part of a file."""
        path = f"{self.root}/{name}"
        with _refusing(path), open(path, "rb", buffering=0) as stream:
            data = os.pread(stream.fileno(), count, offset)
            while len(data) < count and (
                more := os.pread(stream.fileno(), count - len(data), offset + len(data))
            ):  # a read of over 2 GiB comes in parts
                data += more
        return _whole(data, count, path)


class RemoteFiles:
    """The files below a URL that fsspec knows: `s3://`, `hf://`, `https://`, `memory://`.

    Args:
        url: The dataset's folder.
    """

    def __init__(self, url: str) -> None:
        self.address = url.rstrip("/")
        self._fetched: Path | None = None

    def has(self, name: str) -> bool:
        """Return whether there is such a file."""
        filesystem, path = self._at(name)
        with _refusing(f"{self.address}/{name}", Exception):
            return bool(filesystem.isfile(path))

    def get(self, name: str) -> Blob:
        """Fetch a file."""
        filesystem, path = self._at(name)
        shown = f"{self.address}/{name}"
        with _refusing(shown, Exception):
            size = filesystem.size(path)
            if size is not None:
                check_size(shown, size, limits.MAX_TABLE_BYTES)
            return Blob(shown, filesystem.cat_file(path))

    def local(self, name: str) -> Path:
        """Fetch a file into a temporary folder that lives as long as this object."""
        if self._fetched is None:
            self._fetched = Path(tempfile.mkdtemp(prefix="pliant-"))
            weakref.finalize(self, _remove, self._fetched, os.getpid())
        target = self._fetched / name
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            part = target.with_name(f"{target.name}.{os.getpid()}")
            part.write_bytes(self.get(name).data)
            part.replace(target)
        return target

    def read_range(self, name: str, offset: int, count: int) -> bytes:
        """Fetch a part of a file, and no more of it."""
        filesystem, path = self._at(name)
        shown = f"{self.address}/{name}"
        with _refusing(shown, Exception):
            data = filesystem.cat_file(path, start=offset, end=offset + count)
        return _whole(data, count, shown)

    def _at(self, name: str) -> tuple[Any, str]:
        """Return the filesystem (fsspec keeps one a process) and a file's path on it."""
        try:
            import fsspec
        except ImportError as error:
            raise MissingExtraError("opening a URL", "publish") from error
        try:
            filesystem, path = fsspec.core.url_to_fs(f"{self.address}/{name}")
        except (ImportError, ValueError) as error:  # an unknown protocol, or its package missing
            raise SpecError("this URL cannot be opened", path=self.address, found=error) from error
        return filesystem, path

    def __getstate__(self) -> dict[str, Any]:
        """Leave the temporary folder out: it belongs to one process."""
        return {**self.__dict__, "_fetched": None}


class SingleFile:
    """One file of this machine under a name of the layout.

    Args:
        name: Its name in the layout.
        path: Where it is.
    """

    def __init__(self, name: str, path: Path) -> None:
        self._name, self._path, self.address = name, path, str(path)

    def has(self, name: str) -> bool:
        """Return whether this is the name of the file."""
        return name == self._name

    def get(self, name: str) -> Path:
        """Return the file's path."""
        return self._path

    local = get


class LayeredFiles:
    """The private half of a published dataset over its public one: the private file wins.

    Args:
        top: The private half, or a file of it.
        below: The public half.
    """

    def __init__(self, top: Files, below: Files) -> None:
        self._top, self._below, self.address = top, below, below.address

    def has(self, name: str) -> bool:
        """Return whether either half has such a file."""
        return self._top.has(name) or self._below.has(name)

    def get(self, name: str) -> AnyFile:
        """Return a file of the private half, else of the public one."""
        return self._top.get(name) if self._top.has(name) else self._below.get(name)

    def local(self, name: str) -> Path:
        """Return a file of either half as one on this machine."""
        return self._top.local(name) if self._top.has(name) else self._below.local(name)


def storage_of(address: Path | str) -> Storage:
    """Return the storage behind a path or a URL; a name with `://` is a URL."""
    text = str(address)
    return RemoteFiles(text) if "://" in text else LocalFiles(Path(address))


def _remove(folder: Path, process: int) -> None:
    """Remove a temporary folder, in the process that made it (not in one forked from it)."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)


def _whole(data: bytes, count: int, path: str) -> bytes:
    if len(data) != count:
        raise _unreadable(path, f"{len(data)} bytes instead of {count}")
    return data


@contextmanager
def _refusing(path: str, errors: type[Exception] = OSError) -> Iterator[None]:
    """Turn an error of reading a file into its refusal.

    Args:
        path: The file.
        errors: What reading it raises; filesystems of fsspec have errors of their own.
    """
    try:
        yield
    except FileRefusedError:
        raise
    except FileNotFoundError as error:
        raise FileRefusedError("FILE_MISSING", "the file is not there", path=path) from error
    except errors as error:
        raise _unreadable(path, getattr(error, "strerror", None) or error) from error


def _unreadable(path: str, found: object) -> FileRefusedError:
    return FileRefusedError("FILE_UNREADABLE", "the file cannot be read", path=path, found=found)
