"""What Cycles says about depth and object of each pixel: an independent check of the truth.

Nothing that is written to a dataset comes from here; the tests and `benchmarks/truth.py` compare
it with `generator.truth.frame_truth`.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from pliant.generator.rendering import blender
from pliant.generator.rendering.blender_materials import plain_material
from pliant.generator.scene.scene_object import SceneMesh, SceneObject
from pliant.generator.truth.frame_truth import FrameTruth
from pliant.spec.camera import Camera


class PassComparison(NamedTuple):
    """How the truth of a frame and Cycles' passes differ.

    Attributes:
        object_pixels: Pixels on objects, by Cycles.
        id_mismatch_px: Pixels whose object differs.
        depth_error_max_m: Largest difference of planar depth where the objects agree.
        depth_errors: Pixels whose depth differs by more than 1e-5 m.
        cycles_cpu_s: CPU seconds of the pass render.
    """

    object_pixels: int
    id_mismatch_px: int
    depth_error_max_m: float
    depth_errors: int
    cycles_cpu_s: float


class PassRenderer:
    """Renders depth and object passes at pixel centres; it takes over Blender's scene.

    Args:
        size: Width and height, px.
        threads: Threads of Cycles.
    """

    def __init__(self, size: tuple[int, int], threads: int = 1) -> None:
        from pliant.generator.rendering.cycles_styles import CyclesRenderer

        CyclesRenderer.release_scene()
        self._scene = blender.new_scene(size, threads, gpu=False)
        cycles = self._scene.cycles
        cycles.samples = 1
        cycles.max_bounces = 0
        # Sample 0 is at the pixel's centre; the BOX filter would ignore the width.
        cycles.pixel_filter_type = "BLACKMAN_HARRIS"
        cycles.filter_width = 0.01
        layer = self._scene.view_layers[0]
        layer.use_pass_z = layer.use_pass_object_index = True

    def render(
        self, scene_object: SceneObject, truth: FrameTruth, camera: Camera
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32], float]:
        """Render the passes of a frame.

        Returns:
            float32 (H, W), planar depth, +inf where nothing is; uint32 (H, W), object ids; and the
            CPU seconds of a second, warm render.
        """
        blender.remove_meshes(self._scene)
        blender.place_camera(self._scene, camera)
        mesh = SceneMesh.of(scene_object)
        made: list[Any] = []
        for part, _, rows in mesh.parts:
            material = plain_material(part.name)
            vertices = truth.world_vertices[rows]
            made.append(
                blender.add_mesh(
                    self._scene, part.name, vertices, part.faces, {}, material, part.object_id
                )
            )
        blender.render_passes(self._scene)
        for item, (_, _, rows) in zip(made, mesh.parts, strict=True):
            # As a frame of a sequence: the vertices change.
            blender.move_vertices(item, truth.world_vertices[rows])
        started = time.process_time()
        passes = blender.render_passes(self._scene)
        spent = time.process_time() - started
        index = np.rint(passes["IndexOB"][..., 0]).astype(np.uint32)
        depth = np.where(index > 0, passes["Depth"][..., 0], np.inf).astype(np.float32)
        return depth, index, spent


def compare_with_cycles(
    renderer: PassRenderer, scene_object: SceneObject, truth: FrameTruth, camera: Camera
) -> PassComparison:
    """Compare the truth of a frame with Cycles' passes."""
    depth, index, spent = renderer.render(scene_object, truth, camera)
    same = index == truth.surface.object_id
    both = same & (index > 0)
    error = np.abs(depth[both].astype(np.float64) - truth.surface.depth_m[both])
    pixels, differing, far = (int(each.sum()) for each in (index > 0, ~same, error > 1e-5))
    return PassComparison(pixels, differing, float(error.max(initial=0.0)), far, spent)
