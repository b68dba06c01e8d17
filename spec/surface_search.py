"""Where a material point is in a surface image, to a fraction of a pixel.

The surface image names the material point under each pixel's centre. A point that is asked about
is between those of the pixels, so the nearest pixel is only the start: with the local
Jacobian J = d material / d pixel (differences of neighbouring pixels on the same piece of
surface, in metres), the place is p + J^-1 (m - m_p). If that step is longer than a pixel,
the point is not on visible surface: it is hidden there, or is in an occlusion's gap.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.io.exr import Surface
from pliant.spec.model import MaterialObject

_JUMP: Final = 4.0
"""Neighbours whose coordinates differ by more than this times the median belong to other folds."""

_REACH_PX: Final = 1.0
_CHUNK: Final = 64


class SurfaceSearch:
    """Finds material points in one frame; what searches share is computed once.

    Args:
        queried: The queried object.
        surface: The frame's surface image.
    """

    def __init__(self, queried: MaterialObject, surface: Surface) -> None:
        self._queried = queried
        on = surface.object_id == queried.id
        image = np.stack([surface.m0, surface.m1], axis=-1).astype(np.float64)  # (H, W, 2)
        self._rows, self._columns = np.nonzero(on)
        self._seen = image[self._rows, self._columns]  # (M, 2)
        jacobian, known = _jacobian(queried, image, on)
        self._jacobian = jacobian[self._rows, self._columns]  # (M, 2, 2), metres per pixel
        self._usable = known[self._rows, self._columns]
        self._usable &= np.abs(np.linalg.det(self._jacobian)) > 1e-18

    def find(self, material: FloatArray) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Find material points.

        Args:
            material: float64 (N, 2), the points to find.

        Returns:
            uv_px float64 (N, 2), NaN where not found; found bool (N,).
        """
        uv = np.full((len(material), 2), np.nan)
        found = np.zeros(len(material), dtype=np.bool_)
        if len(self._rows) == 0:
            return uv, found
        for start in range(0, len(material), _CHUNK):
            part = material[start : start + _CHUNK]
            steps = self._queried.steps_m(part[:, None] - self._seen[None])  # (n, M, 2)
            nearest = np.argmin((steps**2).sum(axis=-1), axis=1)
            step_m = steps[np.arange(len(part)), nearest]  # (n, 2)
            usable = self._usable[nearest]
            J = np.where(usable[:, None, None], self._jacobian[nearest], np.eye(2))
            step_px = np.linalg.solve(J, step_m[..., None])[..., 0]
            hit = usable & (np.abs(step_px) <= _REACH_PX).all(axis=1)
            pixel = np.stack([self._columns[nearest], self._rows[nearest]], axis=1)
            uv[start : start + _CHUNK] = np.where(hit[:, None], pixel + 0.5 + step_px, np.nan)
            found[start : start + _CHUNK] = hit
        return uv, found


def _jacobian(
    queried: MaterialObject, image: FloatArray, on: npt.NDArray[np.bool_]
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return d material (metres) / d (u, v) per pixel (H, W, 2, 2) and where it is known.

    Central differences where both neighbours are on the same fold, one-sided where one does.
    """
    height, width = on.shape
    J = np.zeros((height, width, 2, 2))
    known = on.copy()
    for axis in (1, 0):  # along columns is d/du, along rows d/dv
        ahead = [slice(None), slice(None)]
        behind = [slice(None), slice(None)]
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        after, before = tuple(ahead), tuple(behind)
        step = queried.steps_m(image[after] - image[before])
        both = on[after] & on[before]
        length = np.linalg.norm(step, axis=-1)
        typical = np.median(length[both]) if both.any() else 0.0
        joined = both & (length <= _JUMP * typical)
        total = np.zeros((height, width, 2))
        count = np.zeros((height, width))
        for side in (before, after):
            total[side] += np.where(joined[..., None], step, 0.0)
            count[side] += joined
        known &= count > 0
        J[..., :, 1 - axis] = total / np.maximum(count, 1)[..., None]
    return J, known
