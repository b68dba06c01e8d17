"""Arrays as long as the split: in memory while they fit a limit, else in temporary files."""

from __future__ import annotations

import tempfile
from typing import Any, Final

import numpy as np
import numpy.typing as npt

MEMORY_LIMIT_BYTES: Final = 640 * 2**20
"""What all arrays of one evaluation may take in memory together (10 million answers scored by
`standard` take about 300 MB); further ones are mapped from temporary files."""


class Scratch:
    """Allocates long arrays.

    Args:
        memory_limit_bytes: Arrays beyond this sum are mapped from temporary files, which the
            system removes with the arrays.

    Attributes:
        on_disk: Whether an array had to go to disk.
    """

    def __init__(self, memory_limit_bytes: int = MEMORY_LIMIT_BYTES) -> None:
        self._left = memory_limit_bytes
        self.on_disk = False

    def full(self, rows: int, dtype: npt.DTypeLike, fill: float | complex) -> npt.NDArray[Any]:
        """Return an array of `rows` values, each `fill`."""
        kind = np.dtype(dtype)
        size = rows * kind.itemsize
        if size <= self._left:
            self._left -= size
            return np.full(rows, fill, kind)
        self.on_disk = True
        with tempfile.TemporaryFile(prefix="pliant-") as file:  # the mapping outlives its name
            array = np.memmap(file, kind, "w+", shape=(max(rows, 1),))[:rows]
        array[:] = fill
        return array
