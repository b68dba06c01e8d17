"""The styles that Cycles renders: `photo`, the whole frame, and `fast`, the object alone.

`fast` spends its samples where the object is. Cycles renders the object's box with the table
hidden from the camera (it still reflects light onto the object), and the result is laid over the
table of `rendering.table`, whose shadows come from our own maps. Few samples, denoised, give the
colour, but not the edges: how much of a pixel the object covers comes from the rasteriser of the
truth.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Final

import numpy as np
from scipy.ndimage import uniform_filter

from pliant.generator.rendering import blender
from pliant.generator.rendering.blender_materials import (
    COLOUR,
    PLACE,
    surface_material,
    table_material,
)
from pliant.generator.rendering.materials import materials, table_reflectance
from pliant.generator.rendering.shadow import shadow_map
from pliant.generator.rendering.sky import sky_maps
from pliant.generator.rendering.srgb import encode_srgb, encode_where
from pliant.generator.rendering.table import TableView
from pliant.generator.scene.appearance import Appearance
from pliant.generator.scene.camera import seen_window
from pliant.generator.scene.scene_object import Pose, SceneMesh, SceneObject
from pliant.generator.truth.frame_truth import FrameTruth
from pliant.generator.truth.rasteriser import rasterise
from pliant.spec.arrays import Float32Array, FloatArray, Rgb
from pliant.spec.camera import Camera
from pliant.spec.errors import GenerationError

Linear = Float32Array

_PHOTO_SAMPLES: Final = 1
# With OpenImageDenoise nearer to 192 samples than four samples without, and cheaper.

_FAST_SAMPLES: Final = 2

_FULL_PX: Final = 640 * 480
_MOST_SAMPLES: Final = 16
# Smaller frames have as many samples in all, up to 16 a pixel: their objects are as thin as what
# the denoiser takes for noise.

_EDGE_WEIGHTS: Final = np.array([0.1016, 0.3984, 0.3984, 0.1016], np.float32)
# Weights of the samples along a side of a pixel, from which `fast` knows how much of it the object
# covers: the pixel filter of Cycles, a Blackman-Harris window 1.5 px wide, at 1/8 and 3/8 px.

_FLOOR_M: Final = 60.0
# Half the side of the table in Blender; its texture ends long before.

_TEXTURE_M: Final = 1.6
_TEXTURE_PX: Final = 1024

_FILTER_PX: Final = 2
# The pixel filter spreads a sample over less than this.


class CyclesRenderer:
    """What both styles share: one scene, whose vertices change.

    Blender keeps one scene a process. A renderer that begins a sequence takes it over.

    Args:
        size: Width and height, px.
        threads: Threads of Cycles.
        gpu: Use a GPU if Cycles finds one.
    """

    _owner: ClassVar[CyclesRenderer | None] = None

    def __init__(self, size: tuple[int, int], threads: int = 1, *, gpu: bool = True) -> None:
        self._size, self._threads, self._gpu = size, threads, gpu
        self._scene: Any = None
        self._objects: list[Any] = []
        self._own_scene()

    def begin(self, scene_object: SceneObject, appearance: Appearance, camera: Camera) -> None:
        """Take what stays the same over a sequence: topology, colours, light, camera."""
        self._own_scene()
        self._camera, self._appearance = camera, appearance
        blender.remove_meshes(self._scene)
        blender.place_camera(self._scene, camera)
        blender.place_light(self._scene, appearance.light)
        self._mesh = SceneMesh.of(scene_object)
        surfaces = materials(scene_object, self._mesh, appearance)
        self._objects = []
        for part, _, rows in self._mesh.parts:
            cloth = scene_object.kind == "cloth" and part.colour is None
            kind = "cloth" if cloth else part.name
            made = blender.add_mesh(
                self._scene,
                part.name,
                part.rest,
                part.faces,
                {PLACE: surfaces.place[rows], COLOUR: surfaces.colour[rows]},
                surface_material(part.name, appearance, kind, (surfaces.front, surfaces.back)),
                part.object_id,
            )
            self._objects.append(made)

    def render(self, pose: Pose, truth: FrameTruth, rng: np.random.Generator | None = None) -> Rgb:
        """Render one frame as `Renderer` says; `rng` is not used."""
        if CyclesRenderer._owner is not self:
            raise GenerationError("another renderer has taken Blender's scene; call begin again")
        for made, (_, _, rows) in zip(self._objects, self._mesh.parts, strict=False):
            blender.move_vertices(made, truth.world_vertices[rows])
        return self._picture(truth)

    @staticmethod
    def release_scene() -> None:
        """Take Blender's scene from whatever renderer has it; its next `begin` makes a new one."""
        CyclesRenderer._owner = None

    def _own_scene(self) -> None:
        if CyclesRenderer._owner is not self:
            self._scene = blender.new_scene(self._size, self._threads, gpu=self._gpu)
            CyclesRenderer._owner = self
            self._set_up()

    def _set_up(self) -> None:
        raise NotImplementedError

    def _picture(self, truth: FrameTruth) -> Rgb:
        raise NotImplementedError

    def _sample(self, least: int) -> None:
        """Set the samples of a pixel, from their number at 640x480."""
        as_many = least * _FULL_PX // (self._size[0] * self._size[1])
        self._scene.cycles.samples = max(least, min(as_many, _MOST_SAMPLES))

    def _denoise(self, guides: str) -> None:
        cycles = self._scene.cycles
        cycles.use_denoising = True
        cycles.denoiser = "OPENIMAGEDENOISE"
        cycles.denoising_input_passes = guides
        cycles.denoising_prefilter = "FAST"
        cycles.denoising_quality = "FAST"

    def _combined(self) -> Linear:
        """Render and return float32 (H, W, 4), linear, premultiplied."""
        passes = blender.render_passes(self._scene)
        if "Combined" not in passes:
            raise RuntimeError("Cycles returned no image")
        return passes["Combined"]

    def _add_table(self, reflectance: Linear, span_m: float) -> Any:
        corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * _FLOOR_M
        place = corners / (2 * span_m) + [0.5, 0.5, 0.0]
        return blender.add_mesh(
            self._scene,
            "table",
            corners,
            np.array([[0, 1, 2], [0, 2, 3]], np.int32),
            {PLACE: place},
            table_material(reflectance),
            0,
        )


class PhotoRenderer(CyclesRenderer):
    """Path tracing of the whole frame, denoised by OpenImageDenoise."""

    def begin(self, scene_object: SceneObject, appearance: Appearance, camera: Camera) -> None:
        """Take what stays the same over a sequence, the table's texture too."""
        super().begin(scene_object, appearance, camera)
        middle = (np.arange(_TEXTURE_PX) + 0.5) / _TEXTURE_PX * 2 * _TEXTURE_M - _TEXTURE_M
        x, y = np.meshgrid(middle, middle)
        places = np.stack([x.ravel(), y.ravel()], axis=1)
        reflectance = table_reflectance(appearance.table, places).astype(np.float32)
        self._add_table(reflectance.reshape(_TEXTURE_PX, _TEXTURE_PX, 3), _TEXTURE_M)

    def _set_up(self) -> None:
        self._sample(_PHOTO_SAMPLES)
        self._denoise("RGB_ALBEDO_NORMAL")

    def _picture(self, truth: FrameTruth) -> Rgb:
        return encode_srgb(self._combined()[..., :3])


class FastRenderer(CyclesRenderer):
    """The object's box by Cycles over a table shaded once per sequence."""

    def begin(self, scene_object: SceneObject, appearance: Appearance, camera: Camera) -> None:
        """Take what stays the same over a sequence, and shade the open table."""
        super().begin(scene_object, appearance, camera)
        self._table = TableView(camera, appearance)
        mean = np.asarray(appearance.table.colour, np.float32).reshape(1, 1, 3)
        self._add_table(mean, _FLOOR_M).visible_camera = False

    def _set_up(self) -> None:
        self._sample(_FAST_SAMPLES)
        self._denoise("RGB")  # of an object over nothing, albedo and normals make the rest worse
        self._scene.render.film_transparent = True

    def _picture(self, truth: FrameTruth) -> Rgb:
        world = truth.world_vertices
        shadow = shadow_map(world, self._mesh.faces, self._appearance.light)
        linear, changed = self._table.under(shadow, sky_maps(world))
        window = seen_window(self._camera, self._camera.project(world), _FILTER_PX)
        if window is not None:
            blender.set_border(self._scene, window)
            left, right, top, bottom = window
            box = linear[top:bottom, left:right]
            layer = self._combined()
            covered = self._covered(world, window)[..., None]
            box *= 1.0 - covered
            box += covered * _object_colour(layer, covered[..., 0])
            changed[top:bottom, left:right] |= covered[..., 0] > 0
        out = self._table.encoded.copy()
        encode_where(changed, linear, out)
        return out

    def _covered(self, world: FloatArray, window: tuple[int, int, int, int]) -> Linear:
        """Return the share of each pixel of a window that the object covers, float32 (h, w)."""
        left, right, top, bottom = window
        size = right - left, bottom - top
        moved = self._camera.K - [[0, 0, left], [0, 0, top], [0, 0, 0]]
        camera = replace(self._camera, K=moved, size=size)
        side = len(_EDGE_WEIGHTS)
        hits = rasterise(camera, camera.to_camera(world), self._mesh.faces, side)
        samples = (hits.triangle >= 0).astype(np.float32).reshape(-1, side) @ _EDGE_WEIGHTS
        covered: Linear = _EDGE_WEIGHTS @ samples.reshape(size[1], side, size[0])
        return covered.clip(0, 1)


def _object_colour(layer: Linear, covered: Linear) -> Linear:
    """Return the object's own colour, float32 (h, w, 3), linear.

    Where samples missed the object, it is the mean over those in the 3x3 pixels that hit it.

    Args:
        layer: float32 (h, w, 4), what Cycles rendered, linear, premultiplied.
        covered: float32 (h, w), the share of each pixel that the object covers.
    """
    edge = (covered > 0) & ((covered < 1) | (layer[..., 3] < 1))
    colour = layer[..., :3].copy()
    around = uniform_filter(layer, (3, 3, 1))[edge]
    colour[edge] = around[:, :3] / np.maximum(around[:, 3:], 1e-3)
    return colour
