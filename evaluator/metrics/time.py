"""The error over the time since the query, on episodes."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pliant.evaluator.metrics.base import Groups, Metric, ScoringContext, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds


class TimeSettings(Settings):
    """Settings of `time`.

    Attributes:
        frames: Numbers of frames between source and target that have a metric of their own.
    """

    frames: Annotated[tuple[int, ...], Bounds(1)]


class Time(Metric[TimeSettings]):
    """RMSE by the number of frames between source and target of one episode.

    Pairs of two sequences, or of one whose frames are not frames in time, have no such number
    and are left out here.
    """

    Settings = TimeSettings
    episodes = True

    def __init__(self, settings: TimeSettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        queries = context.queries
        within = queries.in_episode(context.dataset)
        self._elapsed = np.where(within, np.abs(queries.elapsed), 0)  # (P,); 0 where undefined

    def update(self, block: Block) -> None:
        """Take in one block."""
        squared, counted = block.pair_squared_px2, block.pair_counted
        elapsed = self._elapsed[block.pairs]
        self.table.put("time_squared_px2", block.pairs, squared)
        self.table.put("time_counted", block.pairs, counted)
        for frames in self.settings.frames:
            here = elapsed == frames
            self.table.put(f"time_squared_px2_{frames}", block.pairs, np.where(here, squared, 0))
            self.table.put(f"time_counted_{frames}", block.pairs, np.where(here, counted, 0))

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the curve of each group."""
        columns = self.table.columns
        longest = int(self._elapsed.max(initial=0))
        if longest == 0:
            summary.notes["rmse_over_time"] = "no pair is in one episode"
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
