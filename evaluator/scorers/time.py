"""The error over the time since the query, on episodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pliant.evaluator.arrays import IntArray
from pliant.evaluator.metrics.localisation import sum_by_pair
from pliant.evaluator.scorers.base import Groups, Scorer, ScoringContext, Summary
from pliant.evaluator.submission.blocks import Block


class TimeScorer(Scorer):
    """RMSE by the number of frames between source and target of one episode.

    Pairs of two sequences, or of one whose frames are not frames in time, have no such number
    and are left out here.
    """

    def __init__(self, settings: Mapping[str, Any], context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._elapsed = elapsed_frames(context)

    def update(self, block: Block) -> None:
        """Take in one block."""
        starts = block.starts[:-1]
        squared = sum_by_pair(np.where(block.counted, block.squared_px2, 0.0), starts)
        counted = sum_by_pair(block.counted, starts)
        elapsed = self._elapsed[block.pairs]
        self.table.put("time_squared_px2", block.pairs, squared)
        self.table.put("time_counted", block.pairs, counted)
        for frames in self.settings["frames"]:
            here = elapsed == frames
            self.table.put(f"time_squared_px2_{frames}", block.pairs, np.where(here, squared, 0))
            self.table.put(f"time_counted_{frames}", block.pairs, np.where(here, counted, 0))

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the curve of each group."""
        columns = self.table.columns
        longest = int(self._elapsed.max(initial=0))
        if longest == 0:
            summary.notes["rmse_over_time"] = "no pair lies in one episode"
            return
        for index, name in groups:
            wanted = groups.masks[index] & (self._elapsed > 0)
            since = self._elapsed[wanted]
            counted = np.bincount(since, columns["time_counted"][wanted], longest + 1)
            squared = np.bincount(since, columns["time_squared_px2"][wanted], longest + 1)
            frames = np.flatnonzero(counted)
            if len(frames):
                curve = {
                    "frames": frames.tolist(),
                    "rmse_px": np.sqrt(squared[frames] / counted[frames]).tolist(),
                    "queries": counted[frames].astype(int).tolist(),
                }
                summary.add_curve(name, "rmse_over_time", curve)


def elapsed_frames(context: ScoringContext) -> IntArray:
    """Return the frames between source and target of each pair, int64 (P,); -1 where undefined."""
    queries = context.queries
    temporal = np.array([context.dataset.sequence(s).temporal for s in queries.sequences], bool)
    same = queries.sequence_a == queries.sequence_b
    if not len(same):
        return np.empty(0, np.int64)
    between = np.abs(queries.frame_b.astype(np.int64) - queries.frame_a.astype(np.int64))
    return np.where(same & temporal[queries.sequence_b], between, -1)
