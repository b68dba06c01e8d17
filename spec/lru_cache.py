"""A bounded cache of what was last decoded or computed for a frame."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from typing import Any, Generic, TypeVar

Value = TypeVar("Value")


def _one(value: object) -> int:
    return 1


class LRUCache(Generic[Value]):
    """Keeps the most recently used values by key; safe to use from several threads.

    Args:
        capacity: Sum of the sizes of the values that are kept.
        size_of: Size of a value (default: 1, so that `capacity` is a number of values).
        least: Number of values that are kept whatever their sizes.
    """

    def __init__(
        self, capacity: int, size_of: Callable[[Value], int] = _one, *, least: int = 0
    ) -> None:
        self._capacity, self._size_of, self._least = capacity, size_of, least
        self._kept: OrderedDict[str, Value] = OrderedDict()
        self._total = 0
        self._lock = threading.RLock()

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy in another process starts empty.
        return partial(LRUCache, least=self._least), (self._capacity, self._size_of)

    def get(self, key: str, make: Callable[[], Value]) -> Value:
        """Return the value of a key, making it where it is not cached.

        Args:
            key: Name of the value; a value with an empty name is not cached.
            make: Computes the value.
        """
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        value = make()
        size = self._size(value)
        with self._lock:
            if key and key not in self._kept and size <= self._capacity:
                self._kept[key] = value
                self._total += size
                while self._total > self._capacity:
                    self._total -= self._size(self._kept.popitem(last=False)[1])
        return value

    def _size(self, value: Value) -> int:
        size = self._size_of(value)
        return min(size, self._capacity // self._least) if self._least else size
