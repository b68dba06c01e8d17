"""Jitter on episodes: how much the error of a point moves from one frame to the next."""

from __future__ import annotations

import numpy as np

from pliant.evaluator.metrics.base import Groups, Metric, NoSettings, ScoringContext, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.spec.arrays import FloatArray, IntArray


class Jitter(Metric[NoSettings]):
    """The change of the error between consecutive target frames of one source frame.

    Two image pairs belong to one clip if they have the same source frame, the same temporal
    target sequence and consecutive target frames; a track is a material point asked in both.
    """

    episodes = True
    truth_columns = ("point",)

    def __init__(self, settings: NoSettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._clip = _clips(context)
        self._gathered: list[tuple[IntArray, IntArray, IntArray, IntArray, FloatArray]] = []

    def update(self, block: Block) -> None:
        """Take in one block."""
        clip = self._clip[block.pairs]
        if block.point is None or not (clip >= 0).any():
            return
        wanted = block.counted & (clip[block.pair] >= 0)
        pair = block.first_pair + block.pair[wanted]
        frame = self.context.queries.frame_b[pair].astype(np.int64)
        error = (block.answer_px - block.true_px)[wanted]
        self._gathered.append((self._clip[pair], block.point[wanted], frame, pair, error))

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Join the frames of each track and sum by the later pair."""
        if not self._gathered:
            summary.notes["jitter_px"] = "no point is queried in consecutive frames of an episode"
            return
        clip, point, frame, pair, error = (
            np.concatenate(parts) for parts in zip(*self._gathered, strict=True)
        )
        # Two answers inside the image differ by at most one diagonal, and so do two positions.
        farthest = 2 * self.context.queries.diagonal_px
        _, track = np.unique(np.stack([clip, point], axis=1), axis=0, return_inverse=True)
        row, change = jitter_px(track.reshape(-1), frame, error)
        change = np.where(np.isnan(change), farthest, change)  # an answer is missing
        pairs = self.table.pairs
        total = np.bincount(pair[row], change, pairs)
        self.table.put("sum_jitter_px", slice(None), total)
        self.table.put("jitter_steps", slice(None), np.bincount(pair[row], minlength=pairs))


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


def _clips(context: ScoringContext) -> IntArray:
    """Return each pair's clip, int64 (P,); -1 where it belongs to none with a successor."""
    queries = context.queries
    clip = np.full(queries.pairs, -1, np.int64)
    candidates = np.flatnonzero(queries.temporal(context.dataset))
    key = np.stack([queries.sequence_a, queries.frame_a, queries.sequence_b], axis=1)
    number = np.unique(key[candidates], axis=0, return_inverse=True)[1].reshape(-1)
    frame = queries.frame_b[candidates]
    order = np.lexsort((frame, number))
    following = (np.diff(number[order]) == 0) & (np.diff(frame[order]) == 1)
    near = np.zeros(len(candidates), bool)
    near[order[1:][following]] = True
    near[order[:-1][following]] = True
    clip[candidates[near]] = number[near]
    return clip
