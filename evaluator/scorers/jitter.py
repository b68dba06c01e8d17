"""Jitter of answers that follow one point through the frames of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from pliant.evaluator.arrays import FloatArray, IntArray
from pliant.evaluator.metrics.jitter import jitter_px
from pliant.evaluator.scorers.base import Groups, Scorer, ScoringContext, Summary
from pliant.evaluator.submission.blocks import Block


class JitterScorer(Scorer):
    """The change of the error between consecutive target frames of one source frame.

    Two image pairs belong to one clip if they have the same source frame, the same temporal
    target sequence and consecutive target frames; a track is a material point asked in both.
    """

    truth_columns: ClassVar[tuple[str, ...]] = ("point",)

    def __init__(self, settings: Mapping[str, Any], context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._clip = _clips(context)
        self._gathered: list[tuple[IntArray, IntArray, IntArray, IntArray, FloatArray]] = []

    def update(self, block: Block) -> None:
        """Take in one block."""
        clip = self._clip[block.pairs]
        if block.point is None or not (clip >= 0).any():
            return
        wanted = block.counted & (clip[block.pair] >= 0)
        pair = block.pair[wanted]
        self._gathered.append(
            (
                clip[pair],
                block.point[wanted],
                self.context.queries.frame_b[block.pairs][pair].astype(np.int64),
                block.first_pair + pair,
                (block.answer_px - block.true_px)[wanted],
            )
        )

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Join the frames of each track and sum up by the later pair."""
        self.table.ensure("sum_jitter_px", "jitter_steps")
        if not self._gathered:
            summary.notes["jitter_px"] = "no point is asked in consecutive frames of an episode"
            return
        clip, point, frame, pair, error = (
            np.concatenate(parts) for parts in zip(*self._gathered, strict=True)
        )
        # Two answers inside the image differ by at most one diagonal, and so do two positions.
        farthest = 2 * self.context.queries.diagonal_px
        _, track = np.unique(np.stack([clip, point], axis=1), axis=0, return_inverse=True)
        row, change = jitter_px(track.reshape(-1), frame, error)
        everything = slice(0, self.table.pairs)
        change = np.where(np.isnan(change), farthest, change)  # an answer is missing
        total = np.bincount(pair[row], change, self.table.pairs)
        self.table.put("sum_jitter_px", everything, total)
        count = np.bincount(pair[row], minlength=self.table.pairs)
        self.table.put("jitter_steps", everything, count)


def _clips(context: ScoringContext) -> IntArray:
    """Return each pair's clip, int64 (P,); -1 where it belongs to none with a successor."""
    queries = context.queries
    temporal = np.array([context.dataset.sequence(s).temporal for s in queries.sequences])
    clip = np.full(queries.pairs, -1, np.int64)
    candidates = np.flatnonzero(temporal[queries.sequence_b])
    if not len(candidates):
        return clip
    key = np.stack(
        [
            queries.sequence_a[candidates],
            queries.frame_a[candidates],
            queries.sequence_b[candidates],
        ],
        axis=1,
    )
    _, number = np.unique(key, axis=0, return_inverse=True)
    number = number.reshape(-1)
    frame = queries.frame_b[candidates]
    order = np.lexsort((frame, number))
    following = (np.diff(number[order]) == 0) & (np.diff(frame[order]) == 1)
    near = np.zeros(len(candidates), bool)
    near[order[1:][following]] = True
    near[order[:-1][following]] = True
    clip[candidates[near]] = number[near]
    return clip
