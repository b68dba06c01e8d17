"""A cache of the images that the frames of a dataset have decoded."""

from __future__ import annotations

from typing import Any, Final

import numpy.typing as npt

from pliant.spec.lru_cache import LRUCache

DECODED_BYTES: Final = 128 * 2**20
"""Most bytes of decoded images that a dataset keeps."""

_ENTRY_BYTES: Final = 1024
"""What an entry counts at least: that an image is withheld is remembered too."""

Decoded = tuple[npt.NDArray[Any], ...]


def _bytes_of(arrays: Decoded) -> int:
    return max(_ENTRY_BYTES, sum(array.nbytes for array in arrays))


def decoded_images() -> LRUCache[Decoded]:
    """Return an empty cache of decoded images, for the sequences of one dataset."""
    return LRUCache(DECODED_BYTES, _bytes_of)
