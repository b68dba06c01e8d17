"""The queries of a dataset by pair of frames, with their truth, as recorded answers need them."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.queries import QueryPair, RecordedPair

REACH_PX: Final = 12.0
"""A recorded query counts for a pixel that is at most this far away."""


class SplitQueries:
    """The queries of one split.

    Args:
        dataset: The dataset.
        split: A split with queries.

    Attributes:
        split: The split.
        pairs: Its pairs, in the order of the file.
        starts: int64 (P + 1,), first row of each pair.
        uv_a_px: float64 (R, 2).
        uv_b_px: float64 (R, 2), the truth, or None where the dataset withholds it.
        visibility: (R,), states, or None.
    """

    def __init__(self, dataset: Dataset, split: str) -> None:
        self.split = split
        self.pairs: list[QueryPair] = dataset.pairs(split)
        self.starts = np.cumsum([0, *map(len, self.pairs)])
        parts = [pair.uv_a_px for pair in self.pairs] or [np.zeros((0, 2), np.float32)]
        self.uv_a_px: FloatArray = np.concatenate(parts).astype(np.float64)
        self.uv_b_px: FloatArray | None = None
        self.visibility: npt.NDArray[np.str_] | None = None
        try:
            truth = dataset.truth(split)
        except SpecError:
            return
        columns = [truth[name].to_numpy() for name in ("u_b", "v_b")]
        self.uv_b_px = np.stack(columns, axis=1).astype(np.float64)
        self.visibility = np.array(truth["visibility_b"].to_pylist())

    def rmse_px(self, answers_px: FloatArray) -> list[float | None]:
        """Return the RMSE of each pair over the queries that its target shows.

        Args:
            answers_px: float64 (R, 2), NaN where there is no answer: such rows do not count.

        Returns:
            One value per pair, None where nothing counts.
        """
        if self.uv_b_px is None or self.visibility is None:
            return [None] * len(self.pairs)
        squared = ((answers_px - self.uv_b_px) ** 2).sum(axis=1)
        counts = (self.visibility == "visible") & np.isfinite(squared)
        pair = np.repeat(np.arange(len(self.pairs)), np.diff(self.starts))
        number = np.bincount(pair[counts], minlength=len(self.pairs))
        total = np.bincount(pair[counts], squared[counts], minlength=len(self.pairs))
        return [float(np.sqrt(t / n)) if n else None for t, n in zip(total, number, strict=True)]


class RecordedQueries:
    """The queries of all splits.

    Args:
        dataset: The dataset.
    """

    def __init__(self, dataset: Dataset) -> None:
        self.splits = {
            split: SplitQueries(dataset, split) for split in dataset.splits_with_queries()
        }
        self._rows = {
            (pair.source.key, pair.target.key): (queries, slice(begin, begin + len(pair)))
            for queries in self.splits.values()
            for pair, begin in zip(queries.pairs, queries.starts[:-1].tolist(), strict=True)
        }

    def rows(self, pair: RecordedPair) -> tuple[SplitQueries, slice] | None:
        """Return the queries of a split, and the rows of two frames; None if these have none."""
        return self._rows.get((pair.source.key, pair.target.key))

    def nearest(self, pair: RecordedPair) -> tuple[SplitQueries, int] | None:
        """Return the queries of a split, and the row nearest to a pixel; None if none is near.

        Args:
            pair: The frames and the pixel.
        """
        known = self.rows(pair)
        if known is None:
            return None
        queries, rows = known
        gap = np.linalg.norm(queries.uv_a_px[rows] - pair.uv_a_px[0], axis=1)
        if not len(gap) or gap.min() > REACH_PX:
            return None
        return queries, int(rows.start + gap.argmin())
