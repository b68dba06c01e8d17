"""Walking along a rope's mask with momentum, many walkers at once."""

from __future__ import annotations

from typing import Final

import numpy as np

from pliant.baselines.tracing.depth_in_mask import FloatArray, sampled

STEP_PX: Final = 1.5
_TURNS: Final = np.deg2rad(np.arange(-50, 51, 5))
_LOOK_PX: Final = (1.5, 3.0, 4.5, 7.0)
_LOOK_WEIGHTS: Final = (1.0, 1.0, 0.7, 0.5)
_LEAST_DEPTH: Final = 0.15
_MOST_MISSES: Final = 3
_MOST_STEPS: Final = 1200


def walks(
    depth: FloatArray,
    start_px: FloatArray,
    heading: FloatArray,
    straightness: FloatArray,
    inertia: FloatArray,
) -> list[FloatArray]:
    """Walk from a point until the mask ends, once for each pair of walker settings.

    At each step a walker looks in 21 directions up to 50 degrees from its heading, takes the one
    with the deepest mask ahead, less a cost for turning, turns part of the way, steps, and moves
    towards the middle of the mask.

    Args:
        depth: float64 (H, W), depth in the mask over half the rope's width, at most 1.
        start_px: float64 (2,), where all walkers start.
        heading: float64 (2,), unit vector.
        straightness: float64 (K,), cost of a turn in each walker: high values cross over where
            low values turn off.
        inertia: float64 (K,), share of the heading kept in a step.

    Returns:
        K arrays float64 (N, 2), the places passed.
    """
    count = len(straightness)
    place = np.repeat(start_px[None], count, axis=0)
    way = np.repeat(heading[None], count, axis=0)
    misses = np.zeros(count, dtype=np.int64)
    walking = np.ones(count, dtype=np.bool_)
    path = np.empty((_MOST_STEPS + 1, count, 2))
    path[0] = place
    ended = np.full(count, 1, dtype=np.int64)
    cos, sin = np.cos(_TURNS), np.sin(_TURNS)
    cost = straightness[:, None] * _TURNS**2 * 1.2
    across_px = np.linspace(-1.5, 1.5, 7)
    for step in range(1, _MOST_STEPS + 1):
        ways = np.stack(
            [
                cos * way[:, :1] - sin * way[:, 1:],
                sin * way[:, :1] + cos * way[:, 1:],
            ],
            axis=-1,
        )  # (K, 21, 2)
        ahead = place[:, None, None] + ways[:, :, None] * np.array(_LOOK_PX)[:, None]
        gain = sampled(depth, ahead) @ np.array(_LOOK_WEIGHTS) - cost
        chosen = ways[np.arange(count), gain.argmax(axis=1)]
        way = inertia[:, None] * way + (1 - inertia[:, None]) * chosen
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        place = place + STEP_PX * way
        off = sampled(depth, place) < _LEAST_DEPTH
        misses = np.where(off, misses + 1, 0)
        normal = np.stack([-way[:, 1], way[:, 0]], axis=1)
        weight = sampled(depth, place[:, None] + across_px[:, None] * normal[:, None]) ** 3
        total = weight.sum(axis=1)
        shift = (weight * across_px).sum(axis=1) / np.where(total > 0, total, 1)
        place = place + 0.4 * normal * shift[:, None]
        path[step] = place
        ended = np.where(walking & ~off, step + 1, ended)
        walking &= misses <= _MOST_MISSES
        if not walking.any():
            break
    return [path[: ended[k], k].copy() for k in range(count)]
