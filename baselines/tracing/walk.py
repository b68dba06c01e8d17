"""Walks with momentum along the mask of a rope, vectorised over many walkers."""

from __future__ import annotations

import numpy as np

from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray


def walks(
    depth: FloatArray,
    starts_px: FloatArray,
    headings: FloatArray,
    straightness: FloatArray,
    inertia: FloatArray,
) -> list[FloatArray]:
    """Walk until the mask ends, from each start once for each pair of walker settings.

    At each step a walker looks in 21 directions up to 50 degrees from its heading, takes the one
    with the deepest mask ahead, less a cost for turning, turns part of the way, steps, and moves
    towards the middle of the mask.

    Args:
        depth: float64 (H, W), depth in the mask over half the rope's width, at most 1.
        starts_px: float64 (P, 2), where walkers start.
        headings: float64 (P, 2), unit vectors.
        straightness: float64 (K,), cost of a turn in each walker: high values cross over where
            low values turn off.
        inertia: float64 (K,), share of the heading kept in a step.

    Returns:
        P K arrays float64 (N, 2), the places passed.
    """
    count = len(starts_px) * len(straightness)
    place, way = (np.repeat(each, len(straightness), axis=0) for each in (starts_px, headings))
    straightness, inertia = (np.tile(each, len(starts_px)) for each in (straightness, inertia))
    keep = inertia[:, None]
    walkers = np.arange(count)
    misses = np.zeros(count, dtype=np.int64)
    walking = np.ones(count, dtype=np.bool_)
    path = np.empty((TRACING.walk_most_steps + 1, count, 2))
    path[0] = place
    ended = np.full(count, 1, dtype=np.int64)
    turns = np.deg2rad(np.arange(*TRACING.walk_turns_deg))
    cos, sin = np.cos(turns), np.sin(turns)
    cost = straightness[:, None] * turns**2 * TRACING.walk_turn_cost
    look_px, look_weights = np.array(TRACING.walk_look_px), np.array(TRACING.walk_look_weights)
    across_px = np.linspace(-TRACING.walk_across_px, TRACING.walk_across_px, 7)
    framed = np.pad(depth, 2)
    for step in range(1, TRACING.walk_most_steps + 1):
        directions = np.stack(
            [
                cos * way[:, :1] - sin * way[:, 1:],
                sin * way[:, :1] + cos * way[:, 1:],
            ],
            axis=-1,
        )  # (K, 21, 2)
        ahead = place[:, None, None] + directions[:, :, None] * look_px[:, None]
        gain = sampled(framed, ahead) @ look_weights - cost
        chosen = directions[walkers, gain.argmax(axis=1)]
        way = keep * way + (1 - keep) * chosen
        way /= np.sqrt(way[:, :1] ** 2 + way[:, 1:] ** 2)
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
    u, v = uv_px[..., 0] - 0.5, uv_px[..., 1] - 0.5
    first_u, first_v = np.floor(u), np.floor(v)
    right, down = u - first_u, v - first_v
    left, up = 1 - right, 1 - down
    column = np.minimum(np.maximum(first_u, -2), width - 4)
    row = np.minimum(np.maximum(first_v, -2), height - 4)
    values, at = framed.ravel(), (row * width + column).astype(np.int64) + (2 * width + 2)
    total = left * up * values.take(at) + right * up * values.take(at + 1)
    total += left * down * values.take(at + width)
    return np.asarray(total + right * down * values.take(at + (width + 1)))
