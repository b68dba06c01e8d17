"""What a depth camera over the table makes of a frame: its depth as grey, with its faults.

The camera modelled throws a pattern from its left and looks from its right (structured light, or
stereo with a projector). Three things follow, all along image rows. Ground that falls away to
the right steeper than the pattern comes in is in its shadow and has no depth: slits between
strands that run down the picture, none between those that run across. The right rim of everything
is lost in patches, each row by a length of its own, which frays it; the left rim hardly. And
single pixels fail: pinholes on the object, specks next to it.

Depth becomes grey by a fixed scale, nearer is darker, and is rounded to whole steps. The
table is taken away: black. No renderer has a part in it, and the truth stays as it is.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pliant.generator.scene.appearance import Appearance
from pliant.generator.scene.noise import perlin_noise
from pliant.generator.scene.scene_object import Pose, SceneObject
from pliant.generator.settings.scene import DepthCameraSettings
from pliant.generator.truth.frame_truth import FrameTruth
from pliant.spec.arrays import Float32Array, FloatArray, ImageArray, IntArray, Mask
from pliant.spec.camera import Camera

_LEFT_SHARE: Final = 0.2  # how much the left rim frays, against the right one
_LEFT_STEEPER: Final = 4.0  # how much steeper ground may fall to the left, towards the projector
_LARGEST_SPECK_PX: Final = 5


class DepthCameraRenderer:
    """Draws the `real-depth` style from the frame's exact depth.

    Args:
        settings: The camera's faults.
    """

    def __init__(self, settings: DepthCameraSettings | None = None) -> None:
        self.settings = settings or DepthCameraSettings()

    def begin(self, scene_object: SceneObject, appearance: Appearance, camera: Camera) -> None:
        """Take the sequence's camera; colours and light do not show."""
        self._focal_px = float(camera.K[0, 0])
        self._table_m = table_distance_m(camera)

    def render(
        self, pose: Pose, truth: FrameTruth, rng: np.random.Generator | None = None
    ) -> ImageArray:
        """Render one frame.

        Args:
            pose: The frame's geometry, which is not used: the truth has what is seen of it.
            truth: The frame's truth.
            rng: Source of the faults.

        Returns:
            uint8 (H, W, 3), three times the same grey; 0 means no depth.

        Raises:
            ValueError: There is no `rng`.
        """
        if rng is None:
            raise ValueError("the style real-depth needs a random generator for each frame")
        depth_m = truth.surface.depth_m
        grey = depth_picture(rng, depth_m, self._focal_px, self._table_m, self.settings)
        return np.repeat(grey[..., None], 3, axis=2)


def table_distance_m(camera: Camera) -> float:
    """Return the depth of the table where the camera's axis meets it, metres."""
    forward = camera.world_to_camera[2, :3]
    return float(camera.centre_m[2] / -forward[2])


def depth_picture(
    rng: np.random.Generator,
    depth_m: Float32Array,
    focal_px: float,
    table_m: float,
    settings: DepthCameraSettings,
) -> ImageArray:
    """Draw a depth image as a depth camera would show it.

    Args:
        rng: Source of every random number.
        depth_m: float32 (H, W), planar depth of the objects, +inf elsewhere.
        focal_px: Horizontal focal length.
        table_m: Depth that shows as `table_grey`.
        settings: The faults.

    Returns:
        uint8 (H, W), 1 to 255 where there is a depth, 0 where there is none.
    """
    table_grey = rng.uniform(*settings.table_grey)
    noise_grey = rng.uniform(*settings.noise_grey)
    steepest = rng.uniform(*settings.steepest)
    frayed_px = rng.uniform(*settings.frayed_px)
    patch_px = rng.uniform(*settings.patch_px)
    pinholes = rng.uniform(*settings.pinholes)
    specks = int(rng.poisson(rng.uniform(*settings.specks)))
    shape = depth_m.shape
    on = np.isfinite(depth_m)
    known = np.where(on, depth_m, 0.0).astype(np.float64)
    patches = perlin_noise(rng, shape[0], shape[1], patch_px) / 0.7  # about -1 to 1

    slope = slope_to_the_right(known, on, focal_px)
    # Rows come from the camera one by one: each errs a little by itself.
    limit = steepest * (1.0 + 0.4 * patches + 0.1 * rng.standard_normal((shape[0], 1)))
    kept = on & (slope <= limit) & (slope >= -_LEFT_STEEPER * limit)
    # In a patch each row loses a length of its own; elsewhere next to nothing.
    frayed = frayed_px * rng.exponential(size=shape) * np.clip(0.5 + 1.5 * patches, 0.0, 1.5)
    kept &= pixels_to_the_rim(on) >= np.floor(frayed)
    kept &= pixels_to_the_rim(on[:, ::-1])[:, ::-1] >= np.floor(_LEFT_SHARE * frayed)
    kept &= rng.random(shape) >= pinholes

    values = table_grey * known / table_m + noise_grey * rng.standard_normal(shape)
    grey = np.where(kept, np.clip(np.rint(values), 1, 255), 0).astype(np.uint8)
    _add_specks(rng, grey, on, table_grey, specks)
    return grey


def slope_to_the_right(depth_m: FloatArray, on: Mask, focal_px: float) -> FloatArray:
    """Return how steeply the surface falls away to the right, metres of depth a metre across.

    Args:
        depth_m: float64 (H, W), anything finite off the objects.
        on: bool (H, W), where there is a surface.
        focal_px: Horizontal focal length.

    Returns:
        float64 (H, W): the mean of the differences to both neighbours on the object, that to
        the one where there is one alone, 0 where there is none and off the objects.
    """
    step = np.zeros_like(depth_m)  # from a pixel to its right neighbour
    both = np.zeros_like(on)
    both[:, :-1] = on[:, :-1] & on[:, 1:]
    step[:, :-1] = np.where(both[:, :-1], depth_m[:, 1:] - depth_m[:, :-1], 0.0)
    total, count = step.copy(), both.astype(np.int64)
    total[:, 1:] += step[:, :-1]
    count[:, 1:] += both[:, :-1]
    across_m = np.where(on, depth_m, 1.0) / focal_px
    return np.asarray(total / np.maximum(count, 1) / across_m)


def pixels_to_the_rim(on: Mask) -> IntArray:
    """Return how many pixels of the object follow to the right before its row ends.

    Args:
        on: bool (H, W).

    Returns:
        int64 (H, W): 0 for a row's last pixel and off the object.
    """
    width = on.shape[1]
    column = np.arange(width)
    off = np.where(on, width, column)
    first_off = np.minimum.accumulate(off[:, ::-1], axis=1)[:, ::-1]
    return np.where(on, first_off - column - 1, 0)


def _add_specks(
    rng: np.random.Generator, grey: ImageArray, on: Mask, table_grey: float, count: int
) -> None:
    """Put specks of one to five pixels near the object, in place."""
    height, width = grey.shape
    for _ in range(count):
        row, column = int(rng.integers(height)), int(rng.integers(width))
        value = int(np.clip(rng.normal(0.92, 0.06) * table_grey, 1, 255))
        for _ in range(int(rng.integers(1, _LARGEST_SPECK_PX + 1))):
            if 0 <= row < height and 0 <= column < width and not on[row, column]:
                grey[row, column] = value
            row += int(rng.integers(-1, 2))
            column += int(rng.integers(-1, 2))
