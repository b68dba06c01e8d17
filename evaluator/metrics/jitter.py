"""Jitter on episodes: how much the error moves from one frame to the next."""

from __future__ import annotations

import numpy as np

from pliant.evaluator.arrays import FloatArray, IntArray


def jitter_px(
    track: IntArray, frame: IntArray, error_uv_px: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the change of the error between consecutive frames of a track.

    A steady offset has no jitter; an error that hops about has much.

    Args:
        track: int64 (N,), the same number for one point followed through one episode.
        frame: int64 (N,), frame of the answer; unique in a track.
        error_uv_px: float64 (N, 2), answer minus truth.

    Returns:
        row: int64 (K,), the later of the two answers.
        change_px: float64 (K,), length of the difference of their error vectors.
    """
    order = np.lexsort((frame, track))
    track, frame, error = track[order], frame[order], error_uv_px[order]
    following = (track[1:] == track[:-1]) & (frame[1:] == frame[:-1] + 1)
    change = np.linalg.norm(error[1:] - error[:-1], axis=1)
    return order[1:][following], change[following]
