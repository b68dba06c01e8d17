"""The queries of a split, grouped by image pair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from pliant.spec.errors import SpecError
from pliant.spec.frame import Pair
from pliant.spec.io.parquet_columns import stacked
from pliant.spec.sequence import RecordedFrame


@dataclass(frozen=True, eq=False, repr=False)
class RecordedPair(Pair):
    """Two frames of a dataset, and pixels of the first.

    Attributes:
        source: The frame that the pixels are in.
        target: The frame to find them in.
        uv_a_px: float32 (N, 2), the pixels.
    """

    source: RecordedFrame
    target: RecordedFrame

    def at(self, uv_a_px: npt.ArrayLike) -> Self:
        """Return the same frames with other pixels: (N, 2), or (2,) for one."""
        return replace(self, uv_a_px=np.asarray(uv_a_px, np.float32).reshape(-1, 2))


@dataclass(frozen=True, eq=False, repr=False)
class QueryPair(RecordedPair):
    """The queries of one image pair of a dataset.

    Attributes:
        pair_id: As in the queries.
    """

    pair_id: int

    @property
    def queries(self) -> npt.NDArray[np.float32]:
        """The query pixels (u, v) in the source frame, float32 (N, 2): `uv_a_px`."""
        return self.uv_a_px

    def seen(self, *, masks: bool = True) -> Pair:
        """Return the pair as a method is given it: nothing in it leads to the ground truth.

        Args:
            masks: Whether the method is given masks.
        """
        source, target = (
            each.replace() if masks else each.without_masks() for each in (self.source, self.target)
        )
        return Pair(source, target, self.uv_a_px)

    def __repr__(self) -> str:
        return (
            f"QueryPair({self.pair_id}: {self.source.key} -> {self.target.key}, "
            f"{len(self)} queries)"
        )


def group_queries(
    table: pa.Table, frame: Callable[[str, int], RecordedFrame], *, path: Path
) -> list[QueryPair]:
    """Group a queries table by image pair, in the order of its rows.

    Args:
        table: A table of queries, as `Dataset.queries` returns it.
        frame: Returns a frame by the id of its sequence and its index.
        path: Its file, for messages.

    Raises:
        SpecError: Pairs are not ascending, or the rows of one pair disagree about its frames.
    """
    pair_id = table.column("pair_id").to_numpy()
    if len(pair_id) == 0:
        return []
    if (pair_id[1:] < pair_id[:-1]).any():
        raise SpecError("pair_id is not ascending", path=path, where="pair_id")
    changes = pair_id[1:] != pair_id[:-1]
    starts = np.concatenate([[0], np.nonzero(changes)[0] + 1])
    stops = np.append(starts[1:], len(pair_id))
    frames = {}
    for name in ("sequence_a", "frame_a", "sequence_b", "frame_b"):
        column = table.column(name).combine_chunks()
        differs = pc.not_equal(column[1:], column[:-1]).to_numpy(zero_copy_only=False)
        strays = np.nonzero(differs & ~changes)[0]
        if len(strays):
            raise SpecError(
                f"one pair has two values of {name}",
                path=path,
                where=f"row {strays[0] + 1}, {name}",
            )
        frames[name] = column.take(pa.array(starts)).to_pylist()
    uv_a_px = stacked(table, "u_a", "v_a")
    return [
        QueryPair(
            pair_id=int(pair_id[start]),
            source=frame(frames["sequence_a"][row], frames["frame_a"][row]),
            target=frame(frames["sequence_b"][row], frames["frame_b"][row]),
            uv_a_px=uv_a_px[start:stop],
        )
        for row, (start, stop) in enumerate(zip(starts, stops, strict=True))
    ]
