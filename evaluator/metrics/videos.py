"""The metrics of TAP-Vid counted over whole videos, as published.

Source: Doersch et al., TAP-Vid: A Benchmark for Tracking Any Point in a Video, 2022, section 3,
and the function `compute_tapvid_metrics` published with it: counts are summed over all points and
evaluated frames of a video, figures follow from the sums, and are averaged over videos.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Literal

import numpy as np

from pliant.evaluator.metrics.base import Groups, Metric, ScoringContext, Summary, listed_figures
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.tapvid import Tapvid, TapvidPairs, TapvidSettings
from pliant.evaluator.statistics.ratios import Figure
from pliant.spec.configuration import Settings


class VideosSettings(Settings):
    """Settings of `videos`.

    Attributes:
        tapvid: Thresholds, scale and visibility, as of `tapvid`.
        query_mode: Which frames of a query's video are evaluated: `first`, those after the
            query's frame; `strided`, all but the query's frame.
    """

    tapvid: TapvidSettings
    query_mode: Literal["first", "strided"]


class Videos(Metric[VideosSettings]):
    """Occlusion accuracy, delta_avg and average Jaccard of each video.

    A video is an episode; what its pairs count is summed and is in the first of them.
    """

    Settings = VideosSettings
    episodes = True

    @classmethod
    def figures(cls, settings: VideosSettings) -> list[Figure]:
        """Return TAP-Vid's figures."""
        return listed_figures("tapvid", settings.tapvid, mean="mean over videos", one="video")

    def __init__(self, settings: VideosSettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._pairs = Tapvid(settings.tapvid, context)
        self._counted: list[TapvidPairs] = []
        queries = context.queries
        after = queries.elapsed
        evaluated = after > 0 if settings.query_mode == "first" else after != 0
        self._evaluated = evaluated & queries.in_episode(context.dataset)

    def update(self, block: Block) -> None:
        """Take in one block."""
        self._counted.append(self._pairs.counts(block))

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Sum the counts of each video."""
        self._pairs.finish(groups, summary)
        pairs = np.flatnonzero(self._evaluated)
        if not len(pairs):
            summary.notes["videos"] = "no pair is evaluated: a video is an episode"
        videos, first, video = np.unique(
            self.context.queries.sequence_b[pairs], return_index=True, return_inverse=True
        )
        sums = {}
        for field in fields(TapvidPairs):
            counts = np.concatenate([getattr(each, field.name) for each in self._counted])
            sums[field.name] = np.zeros((len(videos), *counts.shape[1:]), np.int64)
            np.add.at(sums[field.name], video, counts[pairs])
        columns = TapvidPairs(**sums).columns(self.settings.tapvid.thresholds)
        for name, values in {**columns, "video": np.ones(len(videos))}.items():
            column = np.zeros(self.table.pairs)
            column[pairs[first]] = values
            self.table.put(name, slice(None), column)
