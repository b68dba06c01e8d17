"""The pinhole camera of a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera without distortion; x is right, y down, z forward.

    Attributes:
        K: float64 (3, 3), pixels; `[[fx, s, cx], [0, fy, cy], [0, 0, 1]]`, the centre of the first
            pixel at (0.5, 0.5).
        world_to_camera: float64 (4, 4), rigid, metres.
        size: (width, height) of its images, pixels.
    """

    K: npt.NDArray[np.float64]
    world_to_camera: npt.NDArray[np.float64]
    size: tuple[int, int]

    def project(self, points_world: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return where world points are seen.

        Args:
            points_world: float64 (N, 3), metres.

        Returns:
            float64 (N, 3): u, v in pixels and planar depth in metres.
        """
        seen = points_world @ self.world_to_camera[:3, :3].T + self.world_to_camera[:3, 3]
        uvw = seen @ self.K.T
        return np.column_stack([uvw[:, :2] / uvw[:, 2:], seen[:, 2]])
