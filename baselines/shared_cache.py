"""A cache of features that worker processes share."""

from __future__ import annotations

import hashlib
import os
import pickle  # only what copies of the cache wrote into a folder of their own
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from pliant.spec.lru_cache import LRUCache

Value = TypeVar("Value")


class SharedCache(LRUCache[Value]):
    """Keeps the most recently used values, and each value that has a name in a folder.

    Args:
        capacity: Number of values that are kept in memory.
        folder: Where values are stored, made if missing; the caller removes it.
    """

    def __init__(self, capacity: int, folder: Path) -> None:
        super().__init__(capacity)
        self._folder = folder
        folder.mkdir(exist_ok=True)

    def __reduce__(self) -> tuple[Any, ...]:
        return SharedCache, (self._capacity, self._folder)

    def get(self, key: str, make: Callable[[], Value]) -> Value:
        """Return the value of a key, making it where no copy of the cache has stored it."""
        return super().get(key, lambda: self._stored(key, make) if key else make())

    def _stored(self, key: str, make: Callable[[], Value]) -> Value:
        path = self._folder / hashlib.sha256(key.encode()).hexdigest()
        if path.exists():
            stored: Value = pickle.loads(zlib.decompress(path.read_bytes()))
            return stored
        value = make()
        unfinished = path.with_suffix(f".{os.getpid()}")
        unfinished.write_bytes(zlib.compress(pickle.dumps(value), 1))
        unfinished.replace(path)
        return value
