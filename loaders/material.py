"""Distances on the material, and where else a symmetric object may be meant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.dataset import tier_object

FloatArray = npt.NDArray[np.float64]


def material_steps_m(tier: Mapping[str, Any], object_id: int, steps: FloatArray) -> FloatArray:
    """Return differences of material coordinates in metres, wrapped to the period.

    Args:
        tier: A tier of `dataset.json`.
        object_id: The object whose material it is.
        steps: float64 (..., 2), differences of (m0, m1).

    Returns:
        float64 (..., 2).
    """
    material = tier_object(tier, object_id)["material"]
    metres = np.empty_like(steps)
    for axis, coordinate in enumerate(material):
        step = steps[..., axis]
        period = coordinate["period"]
        if period is not None:
            step = step - period * np.round(step / period)
        metres[..., axis] = step * coordinate["metres_per_unit"]
    return metres


def symmetry_orbit(tier: Mapping[str, Any], material: FloatArray) -> FloatArray:
    """Return every material point that looks the same as the given ones, themselves first.

    Args:
        tier: A tier of `dataset.json`.
        material: float64 (N, 2).

    Returns:
        float64 (N, 1 + S, 2), S symmetries in the tier's order.
    """
    images = [material]
    for symmetry in tier["symmetries"]:
        images.append(material @ np.array(symmetry["matrix"], float).T + symmetry["offset"])
    return np.stack(images, axis=1)
