"""The render styles: `photo`, `fast`, `raster` and `real-depth`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from pliant.generator.config import STYLES
from pliant.generator.scene.appearance import Appearance
from pliant.generator.scene.scene_object import Pose, SceneObject
from pliant.generator.truth.frame_truth import FrameTruth
from pliant.spec.arrays import Rgb
from pliant.spec.camera import Camera
from pliant.spec.errors import CallError, MissingExtraError

if TYPE_CHECKING:
    from pliant.generator.settings import DepthCameraSettings


class Renderer(Protocol):
    """Makes the colour images of sequences, one after the other, with one scene."""

    def begin(self, scene_object: SceneObject, appearance: Appearance, camera: Camera) -> None:
        """Take what stays the same over a sequence: topology, colours, light, camera."""
        ...

    def render(self, pose: Pose, truth: FrameTruth, rng: np.random.Generator | None = None) -> Rgb:
        """Render one frame.

        Args:
            pose: The frame's geometry.
            truth: The frame's truth under the camera given to `begin`.
            rng: Source of randomness of this frame; styles without random faults ignore it.

        Returns:
            uint8 (H, W, 3), sRGB; a new array.
        """
        ...


def open_renderer(
    style: str,
    size: tuple[int, int],
    threads: int = 1,
    depth_camera: DepthCameraSettings | None = None,
    *,
    gpu: bool = True,
) -> Renderer:
    """Open a renderer.

    Args:
        style: `photo`, `fast`, `raster` or `real-depth`.
        size: Width and height, px.
        threads: Threads that Blender may use; the other styles use one.
        depth_camera: The faults that `real-depth` shows; None takes the defaults.
        gpu: Use a GPU if Cycles finds one (OptiX, then CUDA).

    Raises:
        CallError: The style is unknown.
        MissingExtraError: `photo` and `fast` need Blender (bpy), the others numba.
    """
    if style not in STYLES:
        raise CallError("unknown style", where="style", found=style, required=", ".join(STYLES))
    try:
        if style == "real-depth":
            from pliant.generator.rendering.depth_camera import DepthCameraRenderer

            return DepthCameraRenderer(depth_camera)
        if style == "raster":
            from pliant.generator.rendering.raster_style import RasterRenderer

            return RasterRenderer(size)
        from pliant.generator.rendering.cycles_styles import FastRenderer, PhotoRenderer
    except ImportError as error:
        raise MissingExtraError(f"the render style '{style}'", "generate") from error
    return (PhotoRenderer if style == "photo" else FastRenderer)(size, threads, gpu=gpu)
