"""Walking along a rope's mask with momentum, many walkers at once."""

from __future__ import annotations

import numpy as np

from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray


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
    path = np.empty((TRACING.walk_most_steps + 1, count, 2))
    path[0] = place
    ended = np.full(count, 1, dtype=np.int64)
    turns = np.deg2rad(np.arange(*TRACING.walk_turns_deg))
    cos, sin = np.cos(turns), np.sin(turns)
    cost = straightness[:, None] * turns**2 * TRACING.walk_turn_cost
    across_px = np.linspace(-TRACING.walk_across_px, TRACING.walk_across_px, 7)
    framed = np.pad(depth, 2)
    for step in range(1, TRACING.walk_most_steps + 1):
        ways = np.stack(
            [
                cos * way[:, :1] - sin * way[:, 1:],
                sin * way[:, :1] + cos * way[:, 1:],
            ],
            axis=-1,
        )  # (K, 21, 2)
        ahead = place[:, None, None] + ways[:, :, None] * np.array(TRACING.walk_look_px)[:, None]
        gain = sampled(framed, ahead) @ np.array(TRACING.walk_look_weights) - cost
        chosen = ways[np.arange(count), gain.argmax(axis=1)]
        way = inertia[:, None] * way + (1 - inertia[:, None]) * chosen
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        place = place + TRACING.walk_step_px * way
        off = sampled(framed, place) < TRACING.walk_least_depth
        misses = np.where(off, misses + 1, 0)
        normal = np.stack([-way[:, 1], way[:, 0]], axis=1)
        weight = sampled(framed, place[:, None] + across_px[:, None] * normal[:, None]) ** 3
        total = weight.sum(axis=1)
        shift = (weight * across_px).sum(axis=1) / np.where(total > 0, total, 1)
        place = place + TRACING.walk_centring * normal * shift[:, None]
        path[step] = place
        ended = np.where(walking & ~off, step + 1, ended)
        walking &= misses <= TRACING.walk_misses
        if not walking.any():
            break
    return [path[: ended[k], k].copy() for k in range(count)]


def sampled(framed: FloatArray, uv_px: FloatArray) -> FloatArray:
    """Return an image's values between its pixels, bilinearly; 0 outside.

    Args:
        framed: float64 (H + 4, W + 4), the image within two rows and columns of zeros.
        uv_px: float64 (..., 2), centre of the image's first pixel at (0.5, 0.5).

    Returns:
        float64 (...).
    """
    height, width = framed.shape
    place = uv_px - 0.5
    corner = np.floor(place)
    share = place - corner
    right, down = share[..., 0], share[..., 1]
    left, up = 1 - right, 1 - down
    column = corner[..., 0].clip(-2, width - 4).astype(np.int64) + 2
    row = corner[..., 1].clip(-2, height - 4).astype(np.int64) + 2
    values, at = framed.ravel(), row * width + column
    total = left * up * values[at] + right * up * values[at + 1]
    total += left * down * values[at + width]
    return np.asarray(total + right * down * values[at + width + 1])
