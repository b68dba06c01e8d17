"""Puts a submission's rows where their queries are: one answer for every query, or a problem."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.evaluator.arrays import BoolArray, FloatArray, IntArray, RealArray
from pliant.evaluator.submission import limits
from pliant.evaluator.submission.batches import Batch, read_batches
from pliant.evaluator.submission.problems import Problems
from pliant.evaluator.submission.queries import Queries
from pliant.evaluator.submission.submission_file import Submission
from pliant.spec.validation.findings import LISTED_PER_CODE

_MODE_WIDTH: Final = 4

MEMORY_LIMIT_BYTES: Final = 640 * 2**20
"""What all arrays of one evaluation may take in memory together (10 million answers scored by
`standard` take about 300 MB); further ones are mapped from temporary files."""


class Scratch:
    """Allocates long arrays.

    Args:
        memory_limit_bytes: Arrays beyond this sum are mapped from temporary files, which the
            system removes with the arrays.

    Attributes:
        on_disk: Whether an array had to go to disk.
    """

    def __init__(self, memory_limit_bytes: int = MEMORY_LIMIT_BYTES) -> None:
        self._left = memory_limit_bytes
        self.on_disk = False

    def full(self, rows: int, dtype: npt.DTypeLike, fill: float | complex) -> npt.NDArray[Any]:
        """Return an array of `rows` values, each `fill`."""
        kind = np.dtype(dtype)
        size = rows * kind.itemsize
        if size <= self._left:
            self._left -= size
            return np.full(rows, fill, kind)
        self.on_disk = True
        with tempfile.TemporaryFile(prefix="pliant-") as file:  # the mapping outlives its name
            array = np.memmap(file, kind, "w+", shape=(max(rows, 1),))[:rows]
        array[:] = fill
        return array


@dataclass(frozen=True)
class Answers:
    """The answers of a split, in the order of its queries.

    Attributes:
        uv_px: float32 or float64 (R, 2); NaN where a row is missing.
        visible: float32 or float64 (R,), probabilities, or None.
        sigma_px: float32 or float64 (R,), or None.
        modes: float32 or float64 (M, 4), the modes of all rows in the order of the file, or None.
        mode_begin: int64 (R,), first mode of each row, or None.
        mode_count: int16 (R,), number of modes of each row, or None.
        answered: Rows that are there.
    """

    uv_px: RealArray
    visible: RealArray | None
    sigma_px: RealArray | None
    modes: RealArray | None
    mode_begin: IntArray | None
    mode_count: npt.NDArray[np.int16] | None
    answered: int

    @property
    def has_distribution(self) -> bool:
        """Whether the answers are distributions."""
        return self.sigma_px is not None or self.modes is not None

    def modes_of(self, rows: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the number of modes of some rows, int64 (N,), and their modes, float64 (K, 4)."""
        if self.modes is None or self.mode_begin is None or self.mode_count is None:
            raise RuntimeError("answers without modes were asked for them")
        count = self.mode_count[rows].astype(np.int64)
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        found = self.modes[np.repeat(self.mode_begin[rows], count) + within]
        return count, found.astype(np.float64)


def read_answers(
    submission: Submission,
    queries: Queries,
    problems: Problems,
    scratch: Scratch,
    *,
    allow_missing: bool = False,
) -> Answers:
    """Read every row of a submission once and put it in its place.

    Args:
        submission: From `open_submission`, of kind `answers`.
        queries: The split's queries.
        problems: Receives whatever is wrong with a row.
        scratch: Where the arrays live.
        allow_missing: A query without a row is not a problem.

    Returns:
        The answers; to be used only if `problems` stays empty.
    """
    rows = queries.rows
    excess = submission.rows - rows
    if excess > limits.MAX_EXCESS_ROWS:
        problems.add_many(
            "ROW_UNKNOWN",
            excess,
            [("", f"found {submission.rows:,} rows; required: {rows:,}, one for each query")],
        )
        return Answers(np.full((0, 2), np.nan), None, None, None, None, None, 0)
    store = _Store(submission, rows, scratch)
    known_rows = 0
    for batch in read_batches(submission, problems):
        row, known = locate(batch, queries, problems)
        known_rows += len(row)
        store.put(batch, row, known)
    answers = store.answers()
    if "FILE_UNREADABLE" in problems.counts:
        return answers  # which rows are in the damaged part, nobody knows
    if known_rows > answers.answered:
        repeated = known_rows - answers.answered
        _note_duplicates(submission, queries, problems, repeated)
    if answers.answered < rows and not allow_missing:
        _note_missing(answers.uv_px, queries, problems)
    return answers


def locate(
    batch: Batch, queries: Queries, problems: Problems | None
) -> tuple[IntArray, BoolArray | None]:
    """Return where the rows of a batch belong.

    Args:
        batch: Some rows.
        queries: The split's queries.
        problems: Receives keys that belong to no query; None notes nothing.

    Returns:
        row: int64 (K,), the query of each known row.
        known: bool (N,), which rows are known (K of them), or None for all.
    """
    pair, query = batch.keys["pair_id"], batch.keys["query_id"]
    if not len(pair):
        return np.empty(0, np.int64), None
    # A query id below the number of rows cannot wrap around when a start is added to it.
    bounded = query.min() >= 0 and query.max() < queries.rows
    if bounded and pair.min() >= 0 and pair.max() < queries.pairs:
        row = queries.starts.take(pair)
        row += query
        if bool((row < queries.starts[1:].take(pair)).all()):
            return row, None
    inside = (pair >= 0) & (pair < queries.pairs) & (query >= 0)
    clipped = np.where(inside, pair, 0)
    known = inside & (query < np.diff(queries.starts)[clipped])
    if problems is not None:

        def describe(row: int) -> tuple[str, str]:
            required = (
                f"query ids below {queries.starts[pair[row] + 1] - queries.starts[pair[row]]}"
                if 0 <= pair[row] < queries.pairs
                else f"pair ids below {queries.pairs}"
            )
            return (
                f"row {batch.begin + row} (pair {pair[row]}, query {query[row]})",
                f"the queries of split {queries.split} have no such key; required: {required}",
            )

        problems.add_rows("ROW_UNKNOWN", ~known, describe)
    row = queries.starts[pair[known]] + query[known]
    return row, known


class _Store:
    """The arrays that rows are scattered into."""

    def __init__(self, submission: Submission, rows: int, scratch: Scratch) -> None:
        kinds = {n: _precision(submission.schema.field(n).type) for n in submission.columns}
        double = np.float64 in (kinds["u"], kinds["v"])
        # One complex number holds u and v: one scattered write a row instead of two.
        self._uv = scratch.full(rows, np.complex128 if double else np.complex64, complex(np.nan, 0))
        self._reals = {
            name: scratch.full(rows, kinds[name], 0.0)
            for name in ("visible", "sigma")
            if name in submission.columns
        }
        self._modes: npt.NDArray[Any] | None = None
        if "modes" in submission.columns:
            self._modes = scratch.full(
                submission.most_modes * _MODE_WIDTH, kinds["modes"], 0.0
            ).reshape(-1, 4)
            self._begin = scratch.full(rows, np.int64, 0)
            self._count = scratch.full(rows, np.int16, 0)
        self._modes_used = 0

    def put(self, batch: Batch, row: IntArray, known: BoolArray | None) -> None:
        """Scatter a batch: `row` is where its `known` rows belong."""
        uv = np.empty(batch.rows, self._uv.dtype)
        with np.errstate(invalid="ignore"):  # of a signalling NaN, noted before
            uv.real, uv.imag = batch.values["u"], batch.values["v"]
        if batch.good is not None:
            uv[~batch.good] = 0  # present, though of no use: not missing as well
        self._uv[row] = uv if known is None else uv[known]
        for name, store in self._reals.items():
            values = batch.values[name]
            store[row] = values if known is None else values[known]
        if batch.modes is not None and self._modes is not None:
            count, values = batch.modes.count, batch.modes.values
            begin = self._modes_used + np.cumsum(count) - count
            small = np.minimum(count, np.iinfo(np.int16).max)
            self._begin[row] = begin if known is None else begin[known]
            self._count[row] = small if known is None else small[known]
            end = self._modes_used + len(values)
            if end <= len(self._modes):
                self._modes[self._modes_used : end] = values
            self._modes_used = end

    def answers(self) -> Answers:
        missing = sum(
            int(np.isnan(self._uv[begin : begin + (1 << 20)].real).sum())
            for begin in range(0, len(self._uv), 1 << 20)
        )
        modes = self._modes
        real = np.float32 if self._uv.dtype == np.complex64 else np.float64
        uv: RealArray = self._uv.view(real)
        return Answers(
            uv_px=uv.reshape(-1, 2),
            visible=self._reals.get("visible"),
            sigma_px=self._reals.get("sigma"),
            modes=modes,
            mode_begin=None if modes is None else self._begin,
            mode_count=None if modes is None else self._count,
            answered=len(self._uv) - missing,
        )


def _precision(kind: pa.DataType) -> type[np.float32 | np.float64]:
    if pa.types.is_dictionary(kind):
        return _precision(kind.value_type)
    if isinstance(kind, pa.ListType | pa.LargeListType | pa.FixedSizeListType):
        double = any(pa.types.is_float64(field.type) for field in kind.value_type)
        return np.float64 if double else np.float32
    return np.float64 if pa.types.is_float64(kind) else np.float32


def _note_duplicates(
    submission: Submission, queries: Queries, problems: Problems, count: int
) -> None:
    """Read the keys once more, until enough rows whose query was answered before are found."""
    first = np.full(queries.rows, -1, np.int64)  # the row of the file that answers a query
    described: list[tuple[str, str]] = []
    ignored = Problems(problems.path)
    for batch in read_batches(submission, ignored):
        row, known = locate(batch, queries, None)
        number = batch.begin + (np.arange(batch.rows) if known is None else np.flatnonzero(known))
        fresh = np.flatnonzero(first[row] < 0)
        first[row[fresh][::-1]] = number[fresh][::-1]  # backwards: the first of equals stays
        for index in np.flatnonzero(first[row] != number)[:LISTED_PER_CODE].tolist():
            pair, query = queries.key(int(row[index]))
            place = f"row {number[index]} (pair {pair}, query {query})"
            before = f"the query was answered before, in row {first[row[index]]}"
            described.append((place, f"{before}; required: one row per query"))
        if len(described) >= LISTED_PER_CODE:
            break
    problems.add_many("ROW_DUPLICATE", count, described[:count])


def _note_missing(uv_px: RealArray, queries: Queries, problems: Problems) -> None:
    def describe(row: int) -> tuple[str, str]:
        pair, query = queries.key(row)
        return (
            f"pair {pair}, query {query}",
            "the query has no answer; required: one row per query (--allow-missing scores what is "
            "there and counts the rest as failures)",
        )

    problems.add_rows("ROW_MISSING", np.isnan(uv_px[:, 0]), describe)
