"""Motion blur: the mean of several renderings while the shutter is open.

The exposure is centred on the frame, so the truth of the frame is that of its middle. Between two
frames every vertex moves on a straight line. The mean is taken in linear light.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from pliant.generator.rendering.srgb import decode_srgb, encode_srgb
from pliant.generator.scene.scene_object import Pose
from pliant.generator.truth.frame_truth import FrameTruth
from pliant.spec.arrays import FloatArray, Rgb
from pliant.spec.camera import Camera

_STEP_PX: Final = 1.5
"""Farthest that anything moves between two renderings."""

_MOST: Final = 9


def with_neighbours(
    frames: Iterator[tuple[Pose, FrameTruth]], shutter: float
) -> Iterator[tuple[Pose, FrameTruth, tuple[FrameTruth | None, FrameTruth | None] | None]]:
    """Yield poses and truths with the truths before and after each, None without a shutter."""
    if not shutter:
        yield from ((pose, truth, None) for pose, truth in frames)
        return
    before, now = None, next(frames, None)
    while now is not None:
        after = next(frames, None)
        yield *now, (before, after and after[1])
        before, now = now[1], after


def blurred(
    render: Callable[[FrameTruth], Rgb],
    camera: Camera,
    now: FrameTruth,
    around: tuple[FrameTruth | None, FrameTruth | None],
    shutter: float,
    fitful: int = 0,
) -> Rgb:
    """Render a frame with motion blur.

    Args:
        render: Renders the vertices of a truth.
        camera: The camera.
        now: Truth of the frame.
        around: Truths of the frames before and after; None at the ends of the episode, where the
            object is taken to stand still.
        shutter: Share of the time between two frames that the shutter is open, 0 to 1.
        fitful: So many of the last vertices are an object that some frames do not show.

    Returns:
        uint8 (H, W, 3), sRGB.
    """
    here = now.world_vertices
    before, after = (
        here if each is None else _continued(here, each.world_vertices, fitful) for each in around
    )
    moved = [camera.project(each)[:, :2] for each in (before, here, after)]
    path_px = 0.5 * shutter * sum(np.hypot(*(b - a).T).max() for a, b in pairwise(moved))
    count = min(1 + math.ceil(path_px / _STEP_PX), _MOST)
    if count == 1:
        return render(now)
    total = np.zeros((camera.height, camera.width, 3))
    for at in shutter * ((np.arange(count) + 0.5) / count - 0.5):
        vertices = here + abs(at) * ((after if at > 0 else before) - here)
        total += decode_srgb(render(replace(now, world_vertices=vertices)))
    return encode_srgb(total / count)


def _continued(here: FloatArray, there: FloatArray, fitful: int) -> FloatArray:
    """Return another frame's vertices; what appears or disappears on the way keeps its place."""
    there = there.copy()
    if fitful and _gone(here[-fitful:]) != _gone(there[-fitful:]):
        there[-fitful:] = here[-fitful:]
    return there


def _gone(vertices: FloatArray) -> bool:
    """Return whether vertices are all in one place, as those of an absent gripper are."""
    return bool((vertices == vertices[0]).all())
