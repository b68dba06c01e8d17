"""Points that are seen again after they were hidden, on episodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.evaluator.metrics.base import Groups, Metric, ScoringContext, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.tapvid import Tapvid, TapvidSettings, tapvid_pairs
from pliant.spec.arrays import BoolArray, IntArray


class Redetection(Metric[TapvidSettings]):
    """TAP-Vid's average Jaccard over the points that have been hidden since the query.

    A track is a point that is asked from one source frame in several frames of its episode. A
    query counts if the same track is hidden in a frame that is asked nearer to the source.
    """

    Settings = TapvidSettings
    episodes = True
    truth_columns = ("point",)

    def __init__(self, settings: TapvidSettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._episode = context.queries.in_episode(context.dataset)
        self._tapvid = Tapvid(settings, context)
        self._gathered: list[list[npt.NDArray[Any]]] = []

    def update(self, block: Block) -> None:
        """Take in one block."""
        wanted = self._episode[block.pairs][block.pair]
        if block.point is None or not wanted.any():
            return
        error, predicted, right = self._tapvid.judged(block)
        pair = block.first_pair + block.pair
        rows = pair, block.point, error, block.counted, predicted, right
        self._gathered.append([each[wanted] for each in rows])

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Count the tracks that have been hidden, pair by pair."""
        if not self._gathered:
            summary.notes["aj_redetected"] = "no point is queried in an episode"
            return
        pair, point, error, visible, predicted, right = map(
            np.concatenate, zip(*self._gathered, strict=True)
        )
        queries, since = self.context.queries, self.context.queries.elapsed
        source = np.stack([queries.sequence_a, queries.frame_a, np.sign(since)], axis=1)[pair]
        track = np.unique(np.column_stack([source, point]), axis=0, return_inverse=True)[1]
        again = hidden_before(track.reshape(-1), np.abs(since[pair]), ~visible)
        counts = tapvid_pairs(
            error[again], visible[again], predicted[again], right[again], pair[again],
            self.table.pairs, self.settings,
        )  # fmt: skip
        columns = counts.columns(self.settings.thresholds)
        for name in ("aj_pair", "jaccard_pair"):
            self.table.put(f"redetected_{name}", slice(None), columns[name])
        if not again.any():
            summary.notes["aj_redetected"] = "no point is queried after it was hidden"


def hidden_before(track: IntArray, frames: IntArray, hidden: BoolArray) -> BoolArray:
    """Return which queries follow a hidden one of the same track.

    Args:
        track: int64 (N,), the same number for one point followed through one episode.
        frames: int64 (N,), frames since the query.
        hidden: bool (N,), the truth.

    Returns:
        bool (N,).
    """
    order = np.lexsort((frames, track))
    before = np.cumsum(hidden[order]) - hidden[order]  # of all tracks so far
    first = np.flatnonzero(np.diff(track[order], prepend=-1))
    at_start = np.repeat(before[first], np.diff(np.append(first, len(track))))
    found = np.zeros(len(track), np.bool_)
    found[order] = before > at_start
    return found
