"""Arrays as long as the split: in memory while they fit a limit, else in temporary files."""

from __future__ import annotations

import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import numpy as np
import numpy.typing as npt

MEMORY_LIMIT_BYTES: Final = 640 * 2**20
"""What all arrays of one evaluation may take in memory together (10 million answers scored by
`standard` take about 300 MB); what comes after lies in files that are mapped and removed."""


class Scratch:
    """Hands out long arrays and removes what it had to put on disk.

    Args:
        memory_limit_bytes: Arrays beyond this sum are mapped from temporary files.
        folder: Where those files go; None is the system's temporary folder.
    """

    def __init__(
        self, memory_limit_bytes: int = MEMORY_LIMIT_BYTES, folder: Path | None = None
    ) -> None:
        self._left = memory_limit_bytes
        self._parent = folder
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._files = 0

    def __enter__(self) -> Scratch:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._folder is not None:
            self._folder.cleanup()

    @property
    def on_disk(self) -> bool:
        """Whether an array had to go to disk."""
        return self._folder is not None

    def full(self, rows: int, dtype: npt.DTypeLike, fill: float | complex) -> npt.NDArray[Any]:
        """Return an array of `rows` values, each `fill`."""
        kind = np.dtype(dtype)
        size = rows * kind.itemsize
        if size <= self._left:
            self._left -= size
            return np.full(rows, fill, kind)
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="pliant-", dir=self._parent)
        self._files += 1
        path = Path(self._folder.name) / f"{self._files:03d}.bin"
        array: npt.NDArray[Any] = np.memmap(path, kind, "w+", shape=(max(rows, 1),))[:rows]
        array[:] = fill
        return array
