"""How a material is oriented in an image, per point: which way it runs, and which side is seen.

Its first coordinate runs along a rope away from one end, or along a cloth's first edge; where it
has an angle about the rope, the angle's sine tells left from right of the centre line.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import Float32Array, FloatArray, RealArray
from pliant.spec.model import MaterialObject

_NEIGHBOURS: Final = 12
_FALL: Final = 2.0
_CHUNK: Final = 256
_LEAST_PX: Final = 1e-3
"""A direction shorter than this, over the spacing of the points, points at the camera."""


class Orientation:
    """Directions of the first material coordinate in an image, and sines of an angular one.

    The direction at a point is the slope of the weighted least-squares plane through its nearest
    neighbours on the material, so that points need not be on a grid.

    Args:
        queried: The object whose material it is.
        material: float (P, 2), material coordinates of its points.
    """

    def __init__(self, queried: MaterialObject, material: RealArray) -> None:
        exact = material.astype(np.float64)
        self._sine = np.full(len(exact), np.nan)
        for axis, coordinate in enumerate(queried.material):
            if coordinate.period is not None:
                self._sine = np.sin(exact[:, axis] * (2 * np.pi / coordinate.period))
        count = min(_NEIGHBOURS, len(exact))
        self._neighbours = _nearest(queried, exact, count)  # (P, K)
        steps = queried.steps_m(exact[self._neighbours] - exact[:, None])
        distance = np.linalg.norm(steps, axis=2, keepdims=True)  # (P, K, 1)
        reach = distance.max(axis=1, keepdims=True).clip(1e-12)
        # Near points count more: which of two equally far ones came last then hardly matters.
        root = np.exp(-_FALL * (distance / reach) ** 2)
        terms = np.concatenate([np.ones_like(distance), steps / reach], axis=2)
        # Row 1 of the pseudo-inverse takes positions to their slope along the first coordinate.
        self._weights = (np.linalg.pinv(root * terms) * root.transpose(0, 2, 1))[:, 1]

    def of(self, uv_px: Float32Array, points: npt.NDArray[np.intp]) -> Float32Array:
        """Return float32 (N, 3): the unit direction (u, v), and the sine of the angle.

        NaN where there is none: a point behind the camera or seen end on has no direction, a
        material without an angular coordinate no sine.

        Args:
            uv_px: float32 (P, 2), where every point projects to; NaN is behind the camera.
            points: intp (N,), rows of the points asked for.
        """
        near = uv_px[self._neighbours[points]].astype(np.float64)  # (N, K, 2)
        slope = np.einsum("nk,nkc->nc", self._weights[points], near)
        length = np.linalg.norm(slope, axis=1, keepdims=True)
        known = np.isfinite(length) & (length > _LEAST_PX)
        direction = np.where(known, slope / np.where(known, length, 1.0), np.nan)
        return np.column_stack([direction, self._sine[points]]).astype(np.float32)


def _nearest(queried: MaterialObject, material: FloatArray, count: int) -> npt.NDArray[np.intp]:
    """Return each point's nearest points in metres, itself among them: intp (P, K)."""
    nearest = np.empty((len(material), count), dtype=np.intp)
    for start in range(0, len(material), _CHUNK):
        part = material[start : start + _CHUNK]
        steps = queried.steps_m(part[:, None] - material)  # (n, P, 2)
        distance = (steps**2).sum(axis=2)
        nearest[start : start + _CHUNK] = np.argpartition(distance, count - 1, axis=1)[:, :count]
    return nearest
