"""The `raster` style: our own renderer over the truth's mesh and rasteriser; no Blender."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from pliant.generator.rendering.deferred import SAMPLES, materials, shade, shader_arguments
from pliant.generator.rendering.shadow import shadow_map
from pliant.generator.rendering.sky import sky_maps, vertex_normals
from pliant.generator.rendering.srgb import encode_srgb
from pliant.generator.rendering.table import TableView
from pliant.generator.scene.appearance import Appearance
from pliant.generator.scene.camera import NEAR_M, Camera
from pliant.generator.scene.scene_mesh import SceneMesh
from pliant.generator.scene.scene_object import FloatArray, Pose, SceneObject
from pliant.generator.truth.frame_truth import FrameTruth
from pliant.generator.truth.rasteriser import rasterise_into

Rgb = npt.NDArray[np.uint8]


class RasterRenderer:
    """Renders with numba alone; one thread, and the same bytes everywhere.

    Args:
        size: Width and height, px.
    """

    style = "raster"

    def __init__(self, size: tuple[int, int]) -> None:
        width, height = size
        self._shape = height * SAMPLES, width * SAMPLES
        self._triangle = np.empty(self._shape, np.int32)
        self._depth = np.empty(self._shape)
        self._weights = np.empty((*self._shape, 2))

    def begin(self, scene_object: SceneObject, appearance: Appearance, camera: Camera) -> None:
        """Take what stays the same over a sequence."""
        self._camera = camera
        self._light = appearance.light
        self._mesh = SceneMesh.of(scene_object)
        self._materials = materials(scene_object, self._mesh, appearance)
        self._two_faced = any(part.double_sided for part in scene_object.parts)
        self._table = TableView(camera, appearance)

    def render(self, pose: Pose, truth: FrameTruth, rng: np.random.Generator | None = None) -> Rgb:
        """Render one frame.

        Args:
            pose: The frame's geometry; the truth holds its vertices.
            truth: The frame's truth.
            rng: Not used.

        Returns:
            uint8 (H, W, 3), sRGB.
        """
        world, faces, light = truth.world_vertices, self._mesh.faces, self._light
        normals = vertex_normals(world, faces)
        shadow, sky = shadow_map(world, faces, light), sky_maps(world)
        open_front = sky.openness(world, normals) * self._materials.crevice
        open_back = sky.openness(world, -normals) if self._two_faced else open_front
        linear, changed = self._table.under(shadow, sky)
        out = self._table.encoded.copy()
        out[changed] = encode_srgb(linear[changed])
        window = self._rasterise(world)
        camera = self._camera
        shade(
            window, self._triangle, self._depth, self._weights, faces, normals,
            open_front, open_back, *shader_arguments(self._materials),
            np.array([camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]]),
            camera.world_to_camera[:3, :3], camera.centre_m,
            np.asarray(light.sun_direction), np.asarray(light.sun_irradiance) / math.pi,
            np.asarray(light.sky_radiance), 0.7 * self._table.reflected, *shadow.arguments(),
            linear, out,
        )  # fmt: skip
        return out

    def close(self) -> None:
        """Nothing is held."""

    def _rasterise(self, world: FloatArray) -> npt.NDArray[np.int64]:
        """Fill the sample buffers and return the window of pixels that the object can touch."""
        camera = self._camera
        local = camera.to_camera(world)
        uvz = camera.to_pixels(local)
        low, high = np.zeros(2, np.int64), np.array([camera.width, camera.height])
        if uvz[:, 2].min() >= NEAR_M:
            size = high.copy()
            low = np.clip(np.floor(uvz[:, :2].min(axis=0)).astype(np.int64), 0, size)
            high = np.clip(np.floor(uvz[:, :2].max(axis=0)).astype(np.int64) + 1, low, size)
        rows = slice(low[1] * SAMPLES, high[1] * SAMPLES)
        columns = slice(low[0] * SAMPLES, high[0] * SAMPLES)
        self._triangle[rows, columns] = -1
        self._depth[rows, columns] = np.inf
        K = camera.K * SAMPLES
        rasterise_into(
            local, uvz[:, :2] * SAMPLES, self._mesh.faces, K[0, 0], K[1, 1], K[0, 2], K[1, 2],
            self._triangle, self._depth, self._weights,
        )  # fmt: skip
        return np.array([low[0], high[0], low[1], high[1]])
