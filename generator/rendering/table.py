"""The table as one camera sees it: shaded once per sequence, shadowed again in each frame.

Under a sun and a uniform sky an open matt plane is bright by a formula, without noise; the
object takes away a share of each light. No renderer is needed for either.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pliant.generator.compiled import compiled
from pliant.generator.rendering.materials import table_reflectance
from pliant.generator.rendering.shadow import ShadowMap, may_shade, sunlight
from pliant.generator.rendering.sky import SkyMaps, openness
from pliant.generator.rendering.srgb import encode_srgb
from pliant.generator.scene.appearance import Appearance
from pliant.spec.arrays import BoolArray, Float32Array, FloatArray, IntArray
from pliant.spec.camera import Camera

_GRID_PX = 4
# The sky's share is worked out every so many pixels and interpolated between.

_TILE_PX = 16
# Side of the tiles that are skipped where no light is missing: a multiple of `_GRID_PX`.


class TableView:
    """The table under one camera and one appearance.

    Attributes:
        linear: float32 (H, W, 3), the table without the object, linear light.
        encoded: uint8 (H, W, 3), the same in sRGB.
        reflected: float64 (3,), mean radiance of the open table; it lights objects from below.
    """

    def __init__(self, camera: Camera, appearance: Appearance) -> None:
        height, width = camera.height, camera.width
        rows, columns = np.arange(height) + 0.5, np.arange(width) + 0.5
        xy, seen = _on_table(camera, columns, rows)
        light = appearance.light
        self._sun = np.asarray(light.sun_irradiance) * light.sun_direction[2] / math.pi
        self._sky = np.asarray(light.sky_radiance)
        horizon, below = _at_horizon(camera, columns, rows)
        reflectance = np.zeros((height * width, 3))
        reflectance[horizon] = appearance.table.colour
        reflectance[seen] = table_reflectance(appearance.table, xy[seen])
        linear = reflectance * (self._sun + self._sky)
        share = below[:, None]
        mixed = share * linear[horizon] + (1.0 - share) * self._sky
        linear[~seen] = self._sky
        linear[horizon] = mixed
        self._reflectance = reflectance.reshape(height, width, 3).astype(np.float32)
        self.reflected = self._reflectance.mean(axis=(0, 1)) * (self._sun + self._sky)
        self._xy = xy.reshape(height, width, 2)
        self.linear = linear.reshape(height, width, 3).astype(np.float32)
        self.encoded = encode_srgb(self.linear)
        self._boxes = _tile_boxes(self._xy)
        # Lattice points past the last row and column are there to interpolate up to the edge.
        grid_rows = np.arange(-(-height // _GRID_PX) + 1) * float(_GRID_PX)
        grid_columns = np.arange(-(-width // _GRID_PX) + 1) * float(_GRID_PX)
        grid, _ = _on_table(camera, grid_columns, grid_rows)
        self._grid = np.concatenate([grid, np.zeros((len(grid), 1))], axis=1)
        self._up = np.broadcast_to([0.0, 0.0, 1.0], self._grid.shape).copy()
        self._grid_shape = len(grid_rows), len(grid_columns)

    def under(
        self, shadow: ShadowMap, sky: SkyMaps, hidden: BoolArray | None = None
    ) -> tuple[Float32Array, BoolArray]:
        """Return the table with the object's shadows on it.

        Args:
            shadow: What the sun sees.
            sky: What the sky sees.
            hidden: bool (H, W), pixels where the table is not seen, which stay as in `linear`.

        Returns:
            float32 (H, W, 3), linear light; bool (H, W), where it differs from `linear`.
        """
        linear = self.linear.copy()
        changed = np.zeros(linear.shape[:2], np.bool_)
        if hidden is None:
            hidden = changed.copy()
        grid = openness(self._grid, self._up, sky).reshape(self._grid_shape)
        ground = _Ground(self._reflectance, self._xy, self._boxes, self._sun, self._sky, grid)
        _shade(ground, shadow, hidden, linear, changed)
        return linear, changed


def _on_table(
    camera: Camera, columns_px: FloatArray, rows_px: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return where the rays of a lattice of image positions meet the table, and whether they do."""
    u, v = np.meshgrid(columns_px, rows_px)
    K, eye = camera.K, camera.centre_m
    rays = np.stack(
        [(u.ravel() - K[0, 2]) / K[0, 0], (v.ravel() - K[1, 2]) / K[1, 1], np.ones(u.size)], axis=1
    )
    rays = rays @ camera.world_to_camera[:3, :3]
    seen = rays[:, 2] < -1e-6
    reach = np.where(seen, -eye[2] / np.where(seen, rays[:, 2], 1.0), 1e6)
    return eye[:2] + reach[:, None] * rays[:, :2], seen


def _at_horizon(
    camera: Camera, columns_px: FloatArray, rows_px: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the pixels of a lattice that the horizon crosses, and how much of them is below it.

    Returns:
        int64 (N,), places in the flattened lattice; float64 (N,), above 0 and below 1.
    """
    K, up = camera.K, camera.world_to_camera[:3, 2]  # a ray (x, y, 1) rises by its product with up
    across, down = up[0] / K[0, 0], up[1] / K[1, 1]
    u, v = columns_px - K[0, 2], rows_px - K[1, 2]
    rise = across * u + (down * v + up[2])[:, None]
    rise_px = rise.ravel() / max(abs(across) + abs(down), 1e-12)
    crossed = np.flatnonzero(np.abs(rise_px) < 0.5)
    return crossed, 0.5 - rise_px[crossed]


def _tile_boxes(xy: FloatArray) -> FloatArray:
    """Return float64 (rows, columns, 2, 2): lowest and highest x and y of each tile's places."""
    down, across = (np.arange(0, side, _TILE_PX) for side in xy.shape[:2])
    ends = [
        each.reduceat(each.reduceat(xy, down, axis=0), across, axis=1)
        for each in (np.minimum, np.maximum)
    ]
    return np.stack(ends, axis=2)


class _Ground(NamedTuple):
    """The open table: reflectance and place per pixel, its light, and the sky's share on a grid."""

    reflectance: Float32Array
    xy: FloatArray
    boxes: FloatArray
    sun: FloatArray
    sky: FloatArray
    grid: FloatArray


@compiled
def _shade(
    ground: _Ground, shadow: ShadowMap, hidden: BoolArray, linear: Float32Array, changed: BoolArray
) -> None:
    """Shade tile by tile; many tiles of a small object's picture miss no light."""
    # Each look into a tuple of arrays inside the loops would count a reference.
    reflectance, xy, boxes, sun, sky, grid = ground
    frame, depth, coarse, texel_m, spread = shadow
    height, width = changed.shape
    cells = _TILE_PX // _GRID_PX
    for tj in range(boxes.shape[0]):
        for ti in range(boxes.shape[1]):
            shaded = may_shade(boxes[tj, ti], shadow)
            around = grid[tj * cells : (tj + 1) * cells + 1, ti * cells : (ti + 1) * cells + 1]
            if not shaded and around.min() == 1.0:
                continue
            for j in range(tj * _TILE_PX, min((tj + 1) * _TILE_PX, height)):
                gv = (j + 0.5) / _GRID_PX
                gj = int(gv)
                fv = gv - gj
                for i in range(ti * _TILE_PX, min((ti + 1) * _TILE_PX, width)):
                    if hidden[j, i]:
                        continue
                    gu = (i + 0.5) / _GRID_PX
                    gi = int(gu)
                    fu = gu - gi
                    open_ = (1.0 - fv) * ((1.0 - fu) * grid[gj, gi] + fu * grid[gj, gi + 1]) + (
                        fv * ((1.0 - fu) * grid[gj + 1, gi] + fu * grid[gj + 1, gi + 1])
                    )
                    lit = 1.0
                    if shaded:
                        x, y = xy[j, i, 0], xy[j, i, 1]
                        lit = sunlight(x, y, 0.0, i, j, frame, depth, coarse, texel_m, spread)
                    if lit < 1.0 or open_ < 0.999:
                        changed[j, i] = True
                        for k in range(3):
                            light = lit * sun[k] + open_ * sky[k]
                            linear[j, i, k] = reflectance[j, i, k] * light
