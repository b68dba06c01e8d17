"""What a submission has to answer: the frozen queries of one split, as pairs of frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.evaluator.arrays import BoolArray, IntArray
from pliant.evaluator.submission.stream import ColumnStream, numbers
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.parquet_columns import codes
from pliant.spec.storage import layout

_BLOCK_ROWS: Final = 1 << 18
_STRINGS: Final = ("tier", "sequence_a", "sequence_b")


@dataclass(frozen=True, eq=False)
class Queries:
    """The image pairs of a split, and where each pair's queries stand.

    The specification numbers pairs and queries consecutively from 0 in file order, so that
    the row of a key is `starts[pair_id] + query_id`: no join is ever needed.

    Attributes:
        split: The split.
        path: Its queries file.
        starts: int64 (P + 1,), first row of each pair; the last entry is the number of rows.
        tiers: Tier names by code.
        tier: int32 (P,), tier code of each pair.
        sequences: Sequence ids by code.
        sequence_a, sequence_b: int32 (P,), sequence codes.
        frame_a, frame_b: int32 (P,), frames.
        size: (width, height) of the images.
    """

    split: str
    path: Path
    starts: IntArray
    tiers: list[str]
    tier: npt.NDArray[np.int32]
    sequences: list[str]
    sequence_a: npt.NDArray[np.int32]
    sequence_b: npt.NDArray[np.int32]
    frame_a: npt.NDArray[np.int32]
    frame_b: npt.NDArray[np.int32]
    size: tuple[int, int]

    @property
    def rows(self) -> int:
        """Number of queries."""
        return int(self.starts[-1])

    @property
    def pairs(self) -> int:
        """Number of image pairs."""
        return len(self.tier)

    @property
    def diagonal_px(self) -> float:
        """Diagonal of the images in pixels."""
        return float(np.hypot(*self.size))

    @property
    def area_px2(self) -> float:
        """Area of the images in square pixels."""
        return float(self.size[0] * self.size[1])

    def temporal(self, dataset: Dataset) -> BoolArray:
        """Return which pairs have a target sequence whose frames are frames in time, bool (P,)."""
        known = np.array([dataset.sequence(name).temporal for name in self.sequences], bool)
        return known[self.sequence_b]

    def key(self, row: int) -> tuple[int, int]:
        """Return (pair_id, query_id) of a row."""
        pair = int(np.searchsorted(self.starts, row, side="right")) - 1
        return pair, row - int(self.starts[pair])


def read_queries(dataset: Dataset, split: str) -> Queries:
    """Read which pairs and queries a split has.

    Args:
        dataset: The dataset.
        split: One of its splits with queries.

    Raises:
        SpecError: The queries file is missing, damaged, or not numbered as specified.
    """
    path = dataset.local(layout.queries_name(split))
    integers = ("pair_id", "query_id", "frame_a", "frame_b")
    stream = ColumnStream(path, [*integers, *_STRINGS], _STRINGS)
    firsts: list[pa.Table] = []  # the first query of each pair
    starts = np.empty(0, np.int64)
    last_pair, last_start = -1, 0
    for begin in range(0, stream.rows, _BLOCK_ROWS):
        table = stream.take(min(_BLOCK_ROWS, stream.rows - begin))
        pair = numbers(table["pair_id"], np.int64)
        step = np.diff(pair, prepend=last_pair)
        first = np.flatnonzero(step)  # rows at which a pair begins, in this block
        begins = np.concatenate([[last_start], begin + first])
        rows = np.arange(begin, begin + len(pair))
        expected = rows - np.repeat(begins, np.diff(np.concatenate([[0], first, [len(pair)]])))
        query = numbers(table["query_id"], np.int64)
        if np.any(step[first] != 1) or not np.array_equal(query, expected):
            raise SpecError(
                "the queries are not numbered consecutively",
                path=path,
                where="pair_id, query_id",
                required="pair ids 0, 1, 2 … and query ids 0, 1, 2 … within each, ascending",
                fix="Run: pliant validate",
            )
        starts = np.append(starts, begin + first)
        firsts.append(_with_text(table.take(first)))
        last_pair, last_start = int(pair[-1]), int(begins[-1])
    if not stream.rows:
        raise SpecError("the split has no queries", path=path, fix="Run: pliant validate")
    pairs = pa.concat_tables(firsts)
    tiers = pairs["tier"].unique().to_pylist()
    unknown = [name for name in tiers if name not in dataset.tiers]
    if unknown:
        raise SpecError("the queries name a tier the dataset has not", path=path, found=unknown[0])
    both = pa.chunked_array([*pairs["sequence_a"].chunks, *pairs["sequence_b"].chunks])
    sequences = both.unique().to_pylist()
    return Queries(
        split=split,
        path=path,
        starts=np.append(starts, stream.rows),
        tiers=tiers,
        tier=codes(pairs["tier"], tiers),
        sequences=sequences,
        sequence_a=codes(pairs["sequence_a"], sequences),
        sequence_b=codes(pairs["sequence_b"], sequences),
        frame_a=numbers(pairs["frame_a"], np.int32),
        frame_b=numbers(pairs["frame_b"], np.int32),
        size=dataset.size,
    )


def _with_text(table: pa.Table) -> pa.Table:
    """Return a table whose dictionaries are plain text, which tables with others can be joined."""
    fields = [
        pa.field(field.name, pa.string()) if field.name in _STRINGS else field
        for field in table.schema
    ]
    return table.cast(pa.schema(fields))
