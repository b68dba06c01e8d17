"""One frame at a working size: image, mask, depth and where its material points are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pyarrow.compute as pc

from pliant.spec.arrays import BoolArray, Float32Array
from pliant.spec.frame import Frame
from pliant.spec.io.parquet_columns import stacked
from pliant.spec.io.resizing import resize_mask, resize_nearest, resize_rgb
from pliant.spec.sequence import RecordedFrame


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class TrainingFrame(Frame):
    """One frame at a working size (w, h), in that size's own pixels, with its ground truth.

    `replace` returns the frame without it.

    Attributes:
        rgb: uint8 (h, w, 3), sRGB.
        mask: bool (h, w), True where at least half the pixel shows the queried object.
        objects: bool (h, w), True where at least half the pixel shows any object but a
            distractor.
        depth_m: float32 (h, w), planar z at the pixel's centre, +inf is background.
        uv_px: float32 (P, 2), where each surface point projects to; NaN is behind the camera.
        visible: bool (P,), True where the camera sees the point.
    """

    mask: BoolArray
    objects: BoolArray
    depth_m: Float32Array
    uv_px: Float32Array
    visible: BoolArray


def draw_points(rng: np.random.Generator, seen: BoolArray, count: int) -> npt.NDArray[np.intp]:
    """Draw rows of surface points, intp (count,): of those seen, bool (P,), where there are any."""
    candidates = np.flatnonzero(seen if seen.any() else ~seen)
    return rng.choice(candidates, count, replace=len(candidates) < count)


def working_key(frame: Frame, size: tuple[int, int]) -> str:
    """Return the `cache_key` of a frame at a working size (w, h)."""
    return f"{frame.cache_key} {size[0]}x{size[1]}"


def read_training_frame(
    frame: RecordedFrame, size: tuple[int, int], points: npt.NDArray[np.intp]
) -> TrainingFrame:
    """Read a frame and bring it to a working size, the truth with it.

    Args:
        frame: The frame.
        size: (w, h).
        points: intp (P,), ids of the points to keep (`surface_points`).

    Returns:
        The frame; its points are in the order of `points`.

    Raises:
        SpecError: A file is missing or damaged, or the tables disagree.
    """
    sequence = frame.sequence
    surface = sequence.surface(frame.index)  # not `frame.surface`: each is needed only once
    table = sequence.correspondences(frame.index)
    scale = np.array([size[0] / sequence.size[0], size[1] / sequence.size[1]])
    uv_full = stacked(table, "u_px", "v_px")[points]
    return TrainingFrame(
        rgb=resize_rgb(sequence.rgb(frame.index), size),
        mask=resize_mask(frame.queried_in(surface.object_id), size),
        objects=resize_mask(frame.objects_in(surface.object_id), size),
        depth_m=resize_nearest(surface.depth_m, size),
        key=frame.key,
        uv_px=(uv_full * scale).astype(np.float32),
        visible=pc.equal(table["visibility"], "visible").to_numpy()[points],
    ).cached_as(working_key(frame, size))
