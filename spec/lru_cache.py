"""A bounded cache of what was last decoded or computed for a frame."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Generic, TypeVar

Value = TypeVar("Value")


def _one(value: object) -> int:
    return 1


class LRUCache(Generic[Value]):
    """Keeps the most recently used values by key; safe to use from several threads.

    Args:
        capacity: Sum of the sizes of the values that are kept.
        size_of: Size of a value (default: 1, so that `capacity` is a number of values).
    """

    def __init__(self, capacity: int, size_of: Callable[[Value], int] = _one) -> None:
        self._capacity, self._size_of = capacity, size_of
        self._kept: OrderedDict[str, Value] = OrderedDict()
        self._size = 0
        self._lock = threading.RLock()

    def __reduce__(self) -> tuple[Any, ...]:
        return LRUCache, (self._capacity, self._size_of)  # a copy in another process starts empty

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
        size = self._size_of(value)
        with self._lock:
            if key and key not in self._kept and size <= self._capacity:
                self._kept[key] = value
                self._size += size
                while self._size > self._capacity:
                    self._size -= self._size_of(self._kept.popitem(last=False)[1])
        return value
