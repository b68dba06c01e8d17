"""The table as one camera sees it: shaded once per sequence, shadowed again in each frame.

Under a sun and a uniform sky an open matt plane is bright by a formula, without noise; the
object takes away a share of each light. No renderer is needed for either.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pliant.generator.compiled import compiled
from pliant.generator.rendering.materials import table_reflectance
from pliant.generator.rendering.shadow import ShadowMap, sunlight
from pliant.generator.rendering.sky import SkyMaps
from pliant.generator.rendering.srgb import encode_srgb
from pliant.generator.scene.appearance import Appearance
from pliant.spec.arrays import FloatArray
from pliant.spec.camera import Camera

_GRID_PX = 4
# The sky's share is worked out every so many pixels and interpolated between.


class TableView:
    """The table under one camera and one appearance.

    Attributes:
        linear: float32 (H, W, 3), the table without the object, linear light.
        encoded: uint8 (H, W, 3), the same in sRGB.
    """

    def __init__(self, camera: Camera, appearance: Appearance) -> None:
        height, width = camera.height, camera.width
        rows, columns = np.arange(height) + 0.5, np.arange(width) + 0.5
        xy, seen = _on_table(camera, columns, rows)
        light = appearance.light
        self._sun = np.asarray(light.sun_irradiance) * light.sun_direction[2] / math.pi
        self._sky = np.asarray(light.sky_radiance)
        reflectance = np.zeros((height * width, 3))
        reflectance[seen] = table_reflectance(appearance.table, xy[seen])
        linear = reflectance * (self._sun + self._sky)
        linear[~seen] = self._sky  # above the horizon
        self._reflectance = reflectance.reshape(height, width, 3).astype(np.float32)
        self._xy = xy.reshape(height, width, 2)
        self.linear = linear.reshape(height, width, 3).astype(np.float32)
        self.encoded = encode_srgb(self.linear)
        # Lattice points past the last row and column are there to interpolate up to the edge.
        grid_rows = np.arange(-(-height // _GRID_PX) + 1) * float(_GRID_PX)
        grid_columns = np.arange(-(-width // _GRID_PX) + 1) * float(_GRID_PX)
        grid, _ = _on_table(camera, grid_columns, grid_rows)
        self._grid = np.concatenate([grid, np.zeros((len(grid), 1))], axis=1)
        self._up = np.broadcast_to([0.0, 0.0, 1.0], self._grid.shape).copy()
        self._grid_shape = len(grid_rows), len(grid_columns)

    @property
    def reflected(self) -> FloatArray:
        """float64 (3,): mean radiance of the open table; it lights objects from below."""
        mean: FloatArray = self._reflectance.mean(axis=(0, 1)) * (self._sun + self._sky)
        return mean

    def under(
        self, shadow: ShadowMap, sky: SkyMaps
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
        """Return the table with the object's shadows on it.

        Args:
            shadow: What the sun sees.
            sky: What the sky sees.

        Returns:
            float32 (H, W, 3), linear light; bool (H, W), where it differs from `linear`.
        """
        linear = self.linear.copy()
        changed = np.zeros(linear.shape[:2], np.bool_)
        grid = sky.openness(self._grid, self._up).reshape(self._grid_shape)
        ground = _Ground(self._reflectance, self._xy, self._sun, self._sky, grid)
        _shade(ground, shadow, linear, changed)
        return linear, changed


def _on_table(
    camera: Camera, columns_px: FloatArray, rows_px: FloatArray
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return where the rays of a lattice of image positions meet the table, and whether they do."""
    u, v = np.meshgrid(columns_px, rows_px)
    K, eye = camera.K, camera.centre_m
    rays = np.stack(
        [
            (u.ravel() - K[0, 2]) / K[0, 0],
            (v.ravel() - K[1, 2]) / K[1, 1],
            np.ones(u.size),
        ],
        axis=1,
    )
    rays = rays @ camera.world_to_camera[:3, :3]
    seen = rays[:, 2] < -1e-6
    reach = np.where(seen, -eye[2] / np.where(seen, rays[:, 2], 1.0), 1e6)
    return eye[:2] + reach[:, None] * rays[:, :2], seen


class _Ground(NamedTuple):
    """The open table: reflectance and place per pixel, its light, and the sky's share on a grid."""

    reflectance: npt.NDArray[np.float32]
    xy: FloatArray
    sun: FloatArray
    sky: FloatArray
    grid: FloatArray


@compiled
def _shade(
    ground: _Ground,
    shadow: ShadowMap,
    linear: npt.NDArray[np.float32],
    changed: npt.NDArray[np.bool_],
) -> None:
    grid, xy, sun, sky = ground.grid, ground.xy, ground.sun, ground.sky
    height, width = changed.shape
    for j in range(height):
        gv = (j + 0.5) / _GRID_PX
        gj = int(gv)
        fv = gv - gj
        for i in range(width):
            gu = (i + 0.5) / _GRID_PX
            gi = int(gu)
            fu = gu - gi
            open_ = (1.0 - fv) * ((1.0 - fu) * grid[gj, gi] + fu * grid[gj, gi + 1]) + fv * (
                (1.0 - fu) * grid[gj + 1, gi] + fu * grid[gj + 1, gi + 1]
            )
            lit = sunlight(xy[j, i, 0], xy[j, i, 1], 0.0, i, j, shadow)
            if lit < 1.0 or open_ < 0.999:
                changed[j, i] = True
                for k in range(3):
                    light = lit * sun[k] + open_ * sky[k]
                    linear[j, i, k] = ground.reflectance[j, i, k] * light
