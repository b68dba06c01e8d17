"""Masks of strands, drawn along given lines."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

SIZE = (480, 640)
V, U = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5


def drawn(line: np.ndarray, half_px: float) -> np.ndarray:
    """A strand of a half width along a line, bool (480, 640)."""
    gap, _ = cKDTree(line).query(np.stack([U, V], axis=-1))
    return np.asarray(gap < half_px)
