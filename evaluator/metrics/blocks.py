"""Walks a split in blocks of whole image pairs: queries, truth and answers side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.evaluator.metrics.errors import squared_error_px2, sum_by_pair
from pliant.evaluator.submission.answers import PlacedAnswers
from pliant.evaluator.submission.queries import Queries, read_columns
from pliant.spec.arrays import BoolArray, FloatArray, IntArray, RealArray, StateArray
from pliant.spec.conventions import VISIBILITY_STATES, VISIBLE
from pliant.spec.errors import SpecError
from pliant.spec.io.parquet_columns import codes
from pliant.spec.opening import foreign_truth

BLOCK_ROWS: Final = 1 << 18
"""A block takes whole pairs up to about so many queries."""


@dataclass(frozen=True)
class Partners:
    """Where the symmetric partners of a block's queries are.

    Attributes:
        begin: int64 (N + 1,), first partner of each query.
        uv_px: float64 (M, 2), positions in the target frame.
        visible: bool (M,).
    """

    begin: IntArray
    uv_px: FloatArray
    visible: BoolArray

    @cached_property
    def query(self) -> IntArray:
        """int64 (M,), the query of each partner."""
        return np.repeat(np.arange(len(self.begin) - 1), np.diff(self.begin))

    @cached_property
    def any_visible(self) -> BoolArray:
        """Bool (N,), queries with a visible partner."""
        found = np.zeros(len(self.begin) - 1, bool)
        found[self.query.take(np.flatnonzero(self.visible))] = True
        return found


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive whole pairs of a split.

    Attributes:
        first_row: Row of the block's first query in the split.
        first_pair: Pair id of its first pair.
        starts: int64 (P + 1,), first row of each pair in the block, and N.
        true_px: float64 (N, 2), the truth in the target frame.
        state: uint8 (N,), visibility in the target frame.
        answer_px: float (N, 2), the answers; NaN where missing.
        missing: bool (N,), queries without an answer, or None if there are none.
        missing_px: The error a missing answer is given.
        uv_a_px: float64 (N, 2), query pixels, if asked for.
        point: int64 (N,), material points, if asked for.
        box_px: float64 (N,), object sizes, if asked for.
        partners: Symmetric partners, if asked for.
        source_on_object, target_on_object: bool (N,), of keypoint matches: whether the keypoint
            is on the queried object.
    """

    first_row: int
    first_pair: int
    starts: IntArray
    true_px: FloatArray
    state: StateArray
    answer_px: RealArray
    missing: BoolArray | None
    missing_px: float
    uv_a_px: FloatArray | None = None
    point: IntArray | None = None
    box_px: FloatArray | None = None
    partners: Partners | None = None
    source_on_object: BoolArray | None = None
    target_on_object: BoolArray | None = None

    @property
    def rows(self) -> slice:
        """The block's rows in the split."""
        return slice(self.first_row, self.first_row + int(self.starts[-1]))

    @property
    def pairs(self) -> slice:
        """The block's pairs in the split."""
        return slice(self.first_pair, self.first_pair + len(self.starts) - 1)

    @cached_property
    def pair(self) -> IntArray:
        """int64 (N,), the pair of each query, counted from the block's first."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))

    @cached_property
    def counted(self) -> BoolArray:
        """Bool (N,), queries whose point is visible in the target frame."""
        return self.state == VISIBLE

    @cached_property
    def counted_rows(self) -> IntArray:
        """int64 (K,), the rows of these queries; `take` is faster with them than with a mask."""
        return np.flatnonzero(self.counted)

    @cached_property
    def counted_pair(self) -> IntArray:
        """int64 (K,), the pair of each of these queries."""
        return self.pair.take(self.counted_rows)

    @cached_property
    def counted_error_px(self) -> FloatArray:
        """float64 (K,), their errors."""
        return self.error_px.take(self.counted_rows)

    @cached_property
    def pair_counted(self) -> FloatArray:
        """float64 (P,), the number of counted queries of each pair."""
        return self.sum_by_pair(self.counted)

    @cached_property
    def pair_error_px(self) -> FloatArray:
        """float64 (P,), the sum of the errors of each pair's counted queries."""
        return self.sum_by_pair(np.where(self.counted, self.error_px, 0.0))

    @cached_property
    def pair_squared_px2(self) -> FloatArray:
        """float64 (P,), the sum of their squares."""
        return self.sum_by_pair(np.where(self.counted, self.squared_px2, 0.0))

    @cached_property
    def lost(self) -> BoolArray:
        """Bool (N,), queries without an answer."""
        return np.zeros(len(self.state), bool) if self.missing is None else self.missing

    @cached_property
    def squared_px2(self) -> FloatArray:
        """float64 (N,), squared errors; of a missing answer, of the stated error."""
        squared = squared_error_px2(self.answer_px, self.true_px)
        if self.missing is not None:
            squared[self.missing] = self.missing_px**2
        return squared

    @cached_property
    def error_px(self) -> FloatArray:
        """float64 (N,), errors; of a missing answer, the stated one."""
        return np.sqrt(self.squared_px2)

    @cached_property
    def reach_px(self) -> FloatArray:
        """float64 (N,), errors to hold against thresholds: inf for a missing answer."""
        if self.missing is None:
            return self.error_px
        return np.where(self.missing, np.inf, self.error_px)

    def sum_by_pair(self, values: npt.NDArray[Any]) -> FloatArray:
        """Return the sum of values, (N,), over each pair, float64 (P,); bool is counted."""
        return sum_by_pair(values, self.starts[:-1])


@dataclass(frozen=True, eq=False)
class SplitTables:
    """The columns of a split that are read once and looked at block by block.

    Attributes:
        path: The truth file.
        truth: Position, state and further columns, one row for each query.
        asked: The query pixels, if asked for.
    """

    path: Path
    truth: pa.Table
    asked: pa.Table | None


def read_tables(
    queries: Queries, truth: Path, truth_columns: Sequence[str] = (), *, query_pixels: bool = False
) -> SplitTables:
    """Read the truth of a split, and its query pixels.

    Args:
        queries: The split's queries.
        truth: The truth file.
        truth_columns: Any of `point`, `box_px`, `alternatives`, read with position and state.
        query_pixels: Whether `uv_a_px` is wanted.

    Raises:
        SpecError: The truth is damaged or has another number of rows.
    """
    names = ["pair_id", "query_id", "u_b", "v_b", "visibility_b", *truth_columns]
    truths = read_columns(truth, names)
    if len(truths) != queries.rows:
        raise foreign_truth(truth, f"{len(truths):,} rows", f"{queries.rows:,} rows")
    asked = read_columns(queries.path, ["u_a", "v_a"]) if query_pixels else None
    return SplitTables(truth, truths, asked)


def read_blocks(
    queries: Queries,
    tables: SplitTables,
    answers: PlacedAnswers,
    block_rows: int | None = None,
    *,
    cap_errors: bool = False,
) -> Iterator[Block]:
    """Yield the split block by block, in order.

    A block ends where the target sequence changes, so that no frame's images are read for two
    blocks, unless a sequence alone is longer than a block.

    Args:
        queries: The split's queries.
        tables: Its truth, whose keys must be those of the queries, row by row.
        answers: The answers in the order of the queries.
        block_rows: About so many queries a block; None takes `BLOCK_ROWS`.
        cap_errors: Move answers to visible points that are further off than the image diagonal
            towards the truth, up to that distance.

    Raises:
        SpecError: The truth is damaged or does not belong to these queries.
    """
    truth, asked, names = tables.path, tables.asked, tables.truth.column_names
    complete = answers.answered == queries.rows
    changes = np.flatnonzero(np.diff(queries.sequence_b)) + 1
    for first_pair, end_pair in _spans(queries.starts, changes, block_rows or BLOCK_ROWS):
        first, end = int(queries.starts[first_pair]), int(queries.starts[end_pair])
        starts = queries.starts[first_pair : end_pair + 1] - first
        table = tables.truth.slice(first, end - first)
        _check_keys(table, truth, first_pair, first, starts)
        state, true_px = _positions(table, truth)
        answer_px = answers.uv_px[first:end]
        if cap_errors:
            answer_px = _capped(answer_px, true_px, state == VISIBLE, queries.diagonal_px)
        yield Block(
            first_row=first,
            first_pair=first_pair,
            starts=starts,
            true_px=true_px,
            state=state,
            answer_px=answer_px,
            missing=None if complete else np.isnan(answer_px[:, 0]),
            missing_px=queries.diagonal_px,
            uv_a_px=None
            if asked is None
            else positions_px(asked.slice(first, end - first), "u_a", "v_a"),
            point=table["point"].to_numpy().astype(np.int64) if "point" in names else None,
            box_px=table["box_px"].to_numpy().astype(np.float64) if "box_px" in names else None,
            partners=_partners(table["alternatives"]) if "alternatives" in names else None,
        )


def positions_px(table: pa.Table, u: str, v: str) -> FloatArray:
    """Return two columns as positions, float64 (N, 2), pixels."""
    uv_px = np.empty((len(table), 2))
    uv_px[:, 0], uv_px[:, 1] = table[u].to_numpy(), table[v].to_numpy()
    return uv_px


def _check_keys(table: pa.Table, truth: Path, pair: int, row: int, starts: IntArray) -> None:
    """Refuse a truth whose keys are not those of the queries.

    Args:
        table: The truth of consecutive whole pairs.
        truth: Its file.
        pair: The first pair.
        row: Its first row.
        starts: int64 (P + 1,), first row of each pair in the table.
    """
    count = np.diff(starts)
    pairs = np.repeat(np.arange(pair, pair + len(count)), count)
    queries = np.arange(len(table)) - np.repeat(starts[:-1], count)
    if not (
        np.array_equal(table["pair_id"].to_numpy(), pairs)
        and np.array_equal(table["query_id"].to_numpy(), queries)
    ):
        found = f"other keys in rows {row} to {row + len(table)}"
        raise foreign_truth(truth, found, "the queries' keys")


def _positions(table: pa.Table, truth: Path) -> tuple[StateArray, FloatArray]:
    """Return the visibility, uint8 (N,), and the true positions, float64 (N, 2), of a truth."""
    state = codes(table["visibility_b"], VISIBILITY_STATES)
    true_px = positions_px(table, "u_b", "v_b")
    if state.min() < 0:
        raise SpecError(
            "an unknown visibility state",
            path=truth,
            where="visibility_b",
            required=", ".join(VISIBILITY_STATES),
        )
    u, v = true_px.T
    if not ((np.isfinite(u) & np.isfinite(v)) | (state != VISIBLE)).all():
        raise SpecError("a visible point has no finite position", path=truth, where="u_b, v_b")
    return state.astype(np.uint8), true_px


def _capped(
    answer_px: RealArray, true_px: FloatArray, visible: BoolArray, most_px: float
) -> FloatArray:
    """Return answers whose error is at most a distance, float64 (N, 2)."""
    capped = answer_px.astype(np.float64)
    offset = capped - true_px
    length = np.hypot(offset[:, 0], offset[:, 1])
    far = np.flatnonzero(visible & (length > most_px))
    capped[far] = true_px[far] + offset[far] * (most_px / length[far])[:, None]
    return capped


def _spans(starts: IntArray, changes: IntArray, block_rows: int) -> Iterator[tuple[int, int]]:
    """Yield (first pair, end pair) of blocks of whole pairs, and of whole sequences if they fit.

    Args:
        starts: int64 (P + 1,), first row of each pair, and the number of rows.
        changes: int64 (C,), pairs at which another target sequence begins.
        block_rows: About so many rows a block.
    """
    pair, pairs = 0, len(starts) - 1
    while pair < pairs:
        end = int(np.searchsorted(starts, starts[pair] + block_rows, side="right")) - 1
        end = min(max(end, pair + 1), pairs)
        if end < pairs:
            last = int(np.searchsorted(changes, end, side="right")) - 1
            if last >= 0 and changes[last] > pair:
                end = int(changes[last])
        yield pair, end
        pair = end


def _partners(column: pa.ChunkedArray) -> Partners:
    begins, parts, visible = [np.zeros(1, np.int64)], [], []
    for chunk in column.chunks:
        offsets = chunk.offsets.to_numpy().astype(np.int64)
        begins.append(offsets[1:] - offsets[0] + begins[-1][-1])
        items = chunk.flatten()
        positions = [items.field(n).to_numpy(zero_copy_only=False) for n in ("u", "v")]
        parts.append(np.stack(positions, axis=1).astype(np.float64))
        visible.append(codes(items.field("visibility"), VISIBILITY_STATES) == VISIBLE)
    return Partners(np.concatenate(begins), np.concatenate(parts), np.concatenate(visible))
