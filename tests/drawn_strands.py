"""Masks of strands, drawn along given lines."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

SIZE = (480, 640)
V, U = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5


def drawn(line: np.ndarray, half_px: float, size: tuple[int, int] = SIZE) -> np.ndarray:
    """A strand of a half width along a line, bool (H, W)."""
    v, u = np.mgrid[: size[0], : size[1]] + 0.5
    gap, _ = cKDTree(line).query(np.stack([u, v], axis=-1), distance_upper_bound=half_px)
    return np.asarray(gap < half_px)  # infinity beyond the bound
