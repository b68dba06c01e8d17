"""The cache that worker processes share."""

from __future__ import annotations

import pickle
from pathlib import Path

from pliant.baselines.shared_cache import SharedCache


def test_copies_find_what_one_of_them_stored(tmp_path: Path) -> None:
    cache: SharedCache[int] = SharedCache(2, tmp_path)
    assert cache.get("a", lambda: 1) == 1
    copy = pickle.loads(pickle.dumps(cache))
    assert copy.get("a", lambda: 2) == 1
    assert copy.get("", lambda: 3) == 3  # has no name, and is not stored
    assert len(list(tmp_path.iterdir())) == 1
