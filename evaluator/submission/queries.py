"""What a submission has to answer: the frozen queries of one split, as pairs of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.arrays import BoolArray, IntArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.parquet import open_table
from pliant.spec.io.parquet_footer import unreadable
from pliant.spec.io.reading import FileRefusedError
from pliant.spec.storage import layout

_INTEGERS: Final = ("pair_id", "query_id", "frame_a", "frame_b")
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

    @property
    def elapsed(self) -> IntArray:
        """Frames from the source to the target, int64 (P,); negative backwards."""
        return self.frame_b.astype(np.int64) - self.frame_a

    def temporal(self, dataset: Dataset) -> BoolArray:
        """Return which pairs have a target sequence whose frames are frames in time, bool (P,)."""
        known = np.array([dataset.sequence(name).temporal for name in self.sequences], bool)
        return known[self.sequence_b]

    def in_episode(self, dataset: Dataset) -> BoolArray:
        """Return which pairs are of two frames of one episode, bool (P,)."""
        return (self.sequence_a == self.sequence_b) & self.temporal(dataset)

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
    table = read_columns(path, (*_INTEGERS, *_STRINGS))
    if not len(table):
        raise SpecError("the split has no queries", path=path, fix="Run: pliant validate")
    pair, query = table["pair_id"].to_numpy(), table["query_id"].to_numpy()
    later = np.flatnonzero(pair[1:] != pair[:-1]) + 1  # rows at which another pair begins
    first = np.append(0, later)
    step = np.diff(query)
    step[later - 1] = 1
    numbered = np.array_equal(pair[first], np.arange(len(first))) and not query[first].any()
    if not numbered or np.any(step != 1):
        raise SpecError(
            "the queries are not numbered consecutively",
            path=path,
            where="pair_id, query_id",
            required="pair ids 0, 1, 2 … and query ids 0, 1, 2 … within each, ascending",
            fix="Run: pliant validate",
        )
    tiers, tier = _coded(table, ("tier",), first)
    unknown = [name for name in tiers if name not in dataset.tiers]
    if unknown:
        raise SpecError("the queries name an unknown tier", path=path, found=unknown[0])
    sequences, both = _coded(table, ("sequence_a", "sequence_b"), first)
    return Queries(
        split=split,
        path=path,
        starts=np.append(first, len(pair)),
        tiers=tiers,
        tier=tier,
        sequences=sequences,
        sequence_a=both[: len(first)],
        sequence_b=both[len(first) :],
        frame_a=table["frame_a"].to_numpy()[first],
        frame_b=table["frame_b"].to_numpy()[first],
        size=dataset.size,
    )


def read_columns(path: Path, columns: Sequence[str]) -> pa.Table:
    """Return some columns without nulls; text arrives as dictionaries, ten million rows in 40 MB.

    Args:
        path: The file.
        columns: The columns to decode; the others are never touched.

    Raises:
        FileRefusedError: The file is missing, damaged, too large, lacks a column, or has a null.
    """
    file = open_table(path)
    names = file.schema_arrow.names
    for name in columns:
        if names.count(name) != 1:
            raise FileRefusedError(
                "COLUMN_MISSING",
                "a column is not there exactly once",
                path=path,
                where=name,
                found=names,
            )
    try:
        # Arrow cannot join the dictionaries of two row groups inside a list: each is read alone.
        groups = [
            file.read_row_group(index, list(columns), use_threads=False)
            for index in range(file.num_row_groups)
        ]
        table = pa.concat_tables(groups) if groups else file.read(list(columns))
    except Exception as error:  # Arrow's errors do not share a base
        raise unreadable(path, error) from error
    for name in columns:
        if table[name].null_count:
            raise FileRefusedError("VALUE_NULL", "null is not allowed", path=path, where=name)
    return table


def _coded(
    table: pa.Table, columns: Sequence[str], rows: IntArray
) -> tuple[list[str], npt.NDArray[np.int32]]:
    """Return the texts of columns in some rows, by first occurrence, and the code of each."""
    parts = [
        chunk.dictionary_decode() if pa.types.is_dictionary(chunk.type) else chunk
        for name in columns
        for chunk in table[name].take(rows).chunks
    ]
    encoded = pa.concat_arrays(parts).dictionary_encode()
    return encoded.dictionary.to_pylist(), encoded.indices.to_numpy()
