"""The pinhole camera of a frame.

Products are written as sums (`einsum`), because the kernels of BLAS round differently from one
processor to another, and the generator's tables must not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray


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

    @property
    def width(self) -> int:
        """Width of the images, pixels."""
        return self.size[0]

    @property
    def height(self) -> int:
        """Height of the images, pixels."""
        return self.size[1]

    @property
    def centre_m(self) -> FloatArray:
        """Where the camera stands, float64 (3,), world metres."""
        return -_product(self.world_to_camera[:3, 3], self.world_to_camera[:3, :3])

    def to_camera(self, points_world: FloatArray) -> FloatArray:
        """Move world points into the camera's axes.

        Args:
            points_world: float64 (N, 3), metres.

        Returns:
            float64 (N, 3), metres; the third column is the planar depth.
        """
        turned = _product(points_world, self.world_to_camera[:3, :3].T)
        return turned + self.world_to_camera[:3, 3]

    def to_pixels(self, points_camera: FloatArray) -> FloatArray:
        """Project points given in the camera's axes.

        Args:
            points_camera: float64 (N, 3), metres.

        Returns:
            float64 (N, 3): u, v in pixels and planar depth in metres. At and behind the camera's
            plane u and v mean nothing, but they are finite.
        """
        x, y, z = points_camera.T
        safe = np.where(np.abs(z) < 1e-9, 1e-9, z)
        u = (self.K[0, 0] * x + self.K[0, 1] * y) / safe + self.K[0, 2]
        v = self.K[1, 1] * y / safe + self.K[1, 2]
        return np.stack([u, v, z], axis=1)

    def project(self, points_world: FloatArray) -> FloatArray:
        """Return where world points are seen.

        Args:
            points_world: float64 (N, 3), metres.

        Returns:
            float64 (N, 3): u, v in pixels and planar depth in metres.
        """
        return self.to_pixels(self.to_camera(points_world))


def _product(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    product: FloatArray = np.einsum("...i,ij->...j", rows, matrix)
    return product
