"""The ball on the rope's origin end."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pliant.generator.scene.scene_object import FloatArray, IntArray

BALL_DEPTH: Final = 0.8
"""The rope's end lies this share of the ball's radius away from the ball's centre."""

_RINGS: Final = 24


def ball_mesh(radius_m: float) -> tuple[FloatArray, IntArray]:
    """Return a sphere around the origin, its poles on the rope's axis.

    Args:
        radius_m: Radius, metres.

    Returns:
        float64 (V, 3) rest positions, metres (first axis along the rope, from the ball into
        it), and int32 (F, 3) triangles, outward winding.
    """
    around = 2 * _RINGS
    polar = math.pi * np.arange(1, _RINGS) / _RINGS
    azimuth = 2.0 * math.pi * np.arange(around) / around
    body = np.stack(
        [
            np.broadcast_to(np.cos(polar)[:, None], (_RINGS - 1, around)),
            np.sin(polar)[:, None] * np.cos(azimuth),
            np.sin(polar)[:, None] * np.sin(azimuth),
        ],
        axis=-1,
    ).reshape(-1, 3)
    rest = radius_m * np.concatenate([[[1.0, 0.0, 0.0]], body, [[-1.0, 0.0, 0.0]]])
    index = 1 + np.arange((_RINGS - 1) * around).reshape(_RINGS - 1, around)
    after = np.roll(index, -1, axis=1)
    a, b, c, d = index[:-1], after[:-1], after[1:], index[1:]
    wall = np.stack([np.stack([a, d, c], axis=-1), np.stack([a, c, b], axis=-1)], axis=-2)
    last = len(rest) - 1
    first_cap = np.stack([np.zeros(around, int), index[0], after[0]], axis=-1)
    last_cap = np.stack([index[-1], np.full(around, last), after[-1]], axis=-1)
    faces = np.concatenate([wall.reshape(-1, 3), first_cap, last_cap]).astype(np.int32)
    return rest, faces


def ball_chart(rest: FloatArray) -> FloatArray:
    """Return the material coordinates of the ball: polar angle and azimuth, radians.

    Args:
        rest: float64 (N, 3).

    Returns:
        float64 (N, 2): 0..pi from the pole in the rope, and -pi..pi around it.
    """
    radial = np.sqrt(rest[:, 1] ** 2 + rest[:, 2] ** 2)
    return np.stack([np.arctan2(radial, rest[:, 0]), np.arctan2(rest[:, 2], rest[:, 1])], axis=1)


def place_ball(rest: FloatArray, centre: FloatArray, frame: FloatArray) -> FloatArray:
    """Return the ball's vertices in the world.

    Args:
        rest: float64 (V, 3), metres.
        centre: float64 (3,), metres.
        frame: float64 (3, 3): tangent, normal, binormal of the rope's first point.

    Returns:
        float64 (V, 3), metres.
    """
    # Written out: a product of matrices may round differently on another machine.
    return np.asarray(
        centre + rest[:, 0:1] * frame[0] + rest[:, 1:2] * frame[1] + rest[:, 2:3] * frame[2]
    )
