"""A small memory of what was last computed for a frame."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Generic, TypeVar

Value = TypeVar("Value")


class LRUCache(Generic[Value]):
    """Keeps the last few values by key; a frame without a key is never kept.

    Args:
        capacity: How many values are kept, >= 1.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._kept: OrderedDict[str, Value] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        return LRUCache, (self._capacity,)  # a copy in another process starts empty

    def get(self, key: str, make: Callable[[], Value]) -> Value:
        """Return the value of a key, making it where it is not remembered.

        Args:
            key: Name of the frame; empty for one that has no name.
            make: Computes the value.
        """
        if not key:
            return make()
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        value = make()
        self._kept[key] = value
        if len(self._kept) > self._capacity:
            self._kept.popitem(last=False)
        return value
