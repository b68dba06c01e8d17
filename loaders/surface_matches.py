"""Pixels of the dense surface images, drawn as queries with their material coordinates."""

from __future__ import annotations

import numpy as np

from pliant.spec.io.images import Surface
from pliant.spec.model import FloatArray


def draw_surface_pixels(
    rng: np.random.Generator, surface: Surface, object_id: int, count: int
) -> tuple[FloatArray, FloatArray]:
    """Draw pixels of the object, with their material coordinates.

    Args:
        rng: Source of randomness.
        surface: The frame's surface image.
        object_id: The queried object.
        count: How many, drawn without replacement while there are enough.

    Returns:
        uv_px float64 (N, 2), pixel centres; material float64 (N, 2). N = 0 if it is not seen.
    """
    rows, columns = np.nonzero(surface.object_id == object_id)
    if len(rows) == 0:
        return np.zeros((0, 2)), np.zeros((0, 2))
    picked = rng.choice(len(rows), size=count, replace=len(rows) < count)
    rows, columns = rows[picked], columns[picked]
    material = np.stack([surface.m0[rows, columns], surface.m1[rows, columns]], axis=1)
    return np.stack([columns, rows], axis=1) + 0.5, material.astype(np.float64)
