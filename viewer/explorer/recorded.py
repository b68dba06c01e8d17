"""The queries of a dataset by pair of frames, with their truth, as recorded answers need them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.queries import QueryPair
from pliant.viewer.explorer.frames import FramePair


@dataclass(frozen=True)
class QueryRow:
    """One query of a split.

    Attributes:
        split: The split.
        pair: Number of the pair in the split.
        row: Row of the query in the split's file.
    """

    split: str
    pair: int
    row: int


class SplitQueries:
    """The queries of one split.

    Args:
        dataset: The dataset.
        split: A split with queries.

    Attributes:
        pairs: Its pairs, in the order of the file.
        starts: int64 (P + 1,), first row of each pair.
        uv_a_px: float64 (R, 2).
        uv_b_px: float64 (R, 2), the truth, or None where the dataset withholds it.
        visibility: (R,), states, or None.
    """

    def __init__(self, dataset: Dataset, split: str) -> None:
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
        self._by_frames = {
            (pair.source.key, pair.target.key): (split, number)
            for split, queries in self.splits.items()
            for number, pair in enumerate(queries.pairs)
        }

    def nearest(self, pair: FramePair, uv_a_px: FloatArray, reach_px: float) -> QueryRow | None:
        """Return the query of a pair of frames that is nearest to a place, or None.

        Args:
            pair: The frames.
            uv_a_px: float64 (2,).
            reach_px: How far away it may be.
        """
        known = self._by_frames.get((pair.source.key, pair.target.key))
        if known is None:
            return None
        split, number = known
        queries = self.splits[split]
        begin, end = queries.starts[number : number + 2]
        gap = np.linalg.norm(queries.uv_a_px[begin:end] - uv_a_px, axis=1)
        if not len(gap) or gap.min() > reach_px:
            return None
        return QueryRow(split, number, int(begin + gap.argmin()))

    def of_pair(self, pair: FramePair) -> tuple[str, slice] | None:
        """Return the split and the rows of a pair of frames, or None if it has no queries."""
        known = self._by_frames.get((pair.source.key, pair.target.key))
        if known is None:
            return None
        split, number = known
        begin, end = self.splits[split].starts[number : number + 2]
        return split, slice(int(begin), int(end))

    def uv_a_px(self, found: QueryRow) -> FloatArray:
        """Return a query's pixel, float64 (2,)."""
        place: FloatArray = self.splits[found.split].uv_a_px[found.row]
        return place

    def truth(self, found: QueryRow) -> tuple[FloatArray | None, str | None]:
        """Return a query's true place and its state in the target, or None where withheld."""
        queries = self.splits[found.split]
        if queries.uv_b_px is None or queries.visibility is None:
            return None, None
        return queries.uv_b_px[found.row], str(queries.visibility[found.row])
