"""Decodes a submission batch by batch into plain arrays, and notes every value it must not hold.

The fast path costs one minimum and one maximum a column; only a batch that fails it is
looked at row by row, to name the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from pliant.evaluator.arrays import BoolArray, IntArray, RealArray
from pliant.evaluator.submission import limits
from pliant.evaluator.submission.problems import Problems
from pliant.evaluator.submission.stream import BATCH_ROWS
from pliant.evaluator.submission.submission_file import MODE_FIELDS, Submission

_RANGES: Final = {
    "sigma": (0.0, limits.MAX_SIGMA_PX, "greater than 0 and at most 1e6 px"),
    "visible": (0.0, 1.0, "a probability, 0 to 1"),
    "weight": (0.0, 1.0, "a weight, 0 to 1"),
}
_POSITION: Final = (
    -limits.MAX_POSITION_PX,
    limits.MAX_POSITION_PX,
    "a finite position within ±1e6 px",
)
_SCORE: Final = (-np.inf, np.inf, "a finite number")


@dataclass(frozen=True)
class Modes:
    """The mixtures of one batch.

    Attributes:
        count: int64 (N,), modes of each row.
        values: float32 or float64 (sum of count, 4): u, v, sigma, weight.
    """

    count: IntArray
    values: RealArray


@dataclass(frozen=True)
class Batch:
    """Some consecutive rows of a submission.

    Attributes:
        begin: Row number of the first.
        keys: int64 (N,) by column name (`pair_id`, `query_id`); -1 stands for a null and for
            what no int64 holds.
        values: float32 or float64 (N,) by column name.
        modes: The mixtures, or None.
        good: bool (N,), rows whose values may all be used, or None for all of them.
    """

    begin: int
    keys: dict[str, IntArray]
    values: dict[str, RealArray]
    modes: Modes | None
    good: BoolArray | None

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.keys["pair_id"])


def read_batches(submission: Submission, problems: Problems) -> Iterator[Batch]:
    """Yield the rows of a submission, and note nulls, non-finite and out-of-range values.

    Args:
        submission: From `open_submission`.
        problems: Receives what is wrong, with row numbers, ids, found and required.
    """
    begin = 0
    iterator = submission.read(BATCH_ROWS)
    while True:
        try:
            record = next(iterator, None)
            with np.errstate(invalid="ignore"):  # a signalling NaN warns of itself
                batch = None if record is None else _decode(record, begin, submission, problems)
        except Exception as error:  # Arrow's errors on a hostile file do not share a base
            text = " ".join(str(error).split())[:200]
            problems.add("FILE_UNREADABLE", f"row {begin} or later", f"cannot be decoded: {text}")
            return
        if batch is None:
            break
        begin += batch.rows
        if begin > submission.rows:
            break
        yield batch
    if begin != submission.rows:
        problems.add(
            "FILE_UNREADABLE",
            "",
            f"found another number of rows than the {submission.rows:,} its footer announces",
        )


def _decode(
    record: pa.RecordBatch, begin: int, submission: Submission, problems: Problems
) -> Batch:
    record.validate(full=True)
    name_row = _row_namer(record, begin)
    good: BoolArray | None = None
    keys: dict[str, IntArray] = {}
    values: dict[str, RealArray] = {}
    modes: Modes | None = None
    for name, kind in submission.columns.items():
        array = _plain(record.column(name))
        if array.null_count and kind != "modes":
            nulls = np.flatnonzero(array.is_null().to_numpy(zero_copy_only=False))
            _note_rows(
                problems, "VALUE_NULL", nulls, name_row, f"{name} is null; required: a value"
            )
            good = _except(good, nulls, len(array))
        if kind == "integer":
            keys[name] = _integers(array)
        elif kind == "modes":
            modes, bad = _read_modes(array, name_row, problems)
            if len(bad):
                good = _except(good, bad, len(array))
        else:
            values[name] = _reals(array)
            present = None if not array.null_count else ~array.is_null().to_numpy(False)
            bad = _bad_values(name, name, values[name], present, name_row, problems)
            if len(bad):
                good = _except(good, bad, len(array))
    return Batch(begin, keys, values, modes, good)


def _plain(array: pa.Array) -> pa.Array:
    return array.dictionary_decode() if pa.types.is_dictionary(array.type) else array


def _integers(array: pa.Array) -> IntArray:
    if array.null_count:
        array = pc.fill_null(array, 0 if pa.types.is_unsigned_integer(array.type) else -1)
    result: npt.NDArray[Any] = array.to_numpy(zero_copy_only=False)
    if result.dtype == np.uint64:
        result = np.minimum(result, np.uint64(2**62))
    return result.astype(np.int64, copy=False)


def _reals(array: pa.Array) -> RealArray:
    if pa.types.is_boolean(array.type):
        array = array.cast(pa.float32())
    result: RealArray = array.to_numpy(zero_copy_only=False)  # a null becomes NaN
    return result


def _except(good: BoolArray | None, bad: IntArray, rows: int) -> BoolArray:
    result = np.ones(rows, bool) if good is None else good
    result[bad] = False
    return result


def _bounds(name: str) -> tuple[float, float, str]:
    return _SCORE if name == "score" else _RANGES.get(name, _POSITION)


def _bad_values(
    name: str,
    label: str,
    values: RealArray,
    present: BoolArray | None,
    name_row: Callable[[int], str],
    problems: Problems,
) -> IntArray:
    """Note the values of one column that are not finite or out of range; return their rows."""
    low, high, required = _bounds(name)
    strict = name == "sigma"
    if not len(values):
        return np.empty(0, np.int64)
    smallest, largest = values.min(), values.max()  # NaN if there is one: then nothing compares
    if (smallest > low if strict else smallest >= low) and largest <= high and largest < np.inf:
        return np.empty(0, np.int64)
    not_finite = ~np.isfinite(values)
    with np.errstate(invalid="ignore"):
        outside = ~not_finite & ((values <= low if strict else values < low) | (values > high))
    if present is not None:
        not_finite &= present
        outside &= present

    def describe(row: int) -> tuple[str, str]:
        return name_row(row), f"{label} is {values[row]!s}; required: {required}"

    for code, mask in (("VALUE_NOT_FINITE", not_finite), ("VALUE_OUT_OF_RANGE", outside)):
        rows = np.flatnonzero(mask)
        problems.add_rows(code, rows.tolist(), len(rows), describe)
    return np.flatnonzero(not_finite | outside)


def _note_rows(
    problems: Problems, code: str, rows: IntArray, name_row: Callable[[int], str], message: str
) -> None:
    problems.add_rows(code, rows.tolist(), len(rows), lambda row: (name_row(row), message))


def _row_namer(record: pa.RecordBatch, begin: int) -> Callable[[int], str]:
    """Return a function that names a row by its number and its ids, as the file has them."""
    names = [name for name in ("pair_id", "query_id") if name in record.schema.names]

    def name_row(row: int) -> str:
        ids = ", ".join(f"{name[:-3]} {record.column(name)[row].as_py()}" for name in names)
        return f"row {begin + row} ({ids})"

    return name_row


def _read_modes(
    array: pa.Array, name_row: Callable[[int], str], problems: Problems
) -> tuple[Modes, IntArray]:
    """Read the mixtures of a batch; return them with the rows that may not be used."""
    rows = len(array)
    bad = np.zeros(rows, bool)
    if array.null_count:
        nulls = np.flatnonzero(array.is_null().to_numpy(zero_copy_only=False))
        _note_rows(problems, "VALUE_NULL", nulls, name_row, "modes is null; required: a list")
        bad[nulls] = True
    count = pc.fill_null(pc.list_value_length(array), 0).to_numpy(zero_copy_only=False)
    count = count.astype(np.int64)
    items = pc.list_flatten(array)
    owner = np.repeat(np.arange(rows), count)
    if pa.types.is_fixed_size_list(array.type) and array.null_count:
        count[bad] = 0
        owner = np.repeat(np.arange(rows), count)
    columns = []
    for name in MODE_FIELDS:
        field = pc.struct_field(items, name)
        if field.null_count:
            of_rows = np.unique(owner[field.is_null().to_numpy(zero_copy_only=False)])
            _note_rows(
                problems,
                "VALUE_NULL",
                of_rows,
                name_row,
                f"modes holds a null {name}; required: a value",
            )
            bad[of_rows] = True
            field = pc.fill_null(field, 1.0)
        values = _reals(field)
        wrong = _bad_values(
            name, f"modes.{name}", values, None, lambda mode: name_row(int(owner[mode])), problems
        )
        bad[owner[wrong]] = True
        columns.append(values)
    values = np.stack(columns, axis=1) if columns[0].size else np.zeros((0, 4), np.float32)
    bad |= _bad_mixtures(count, owner, values[:, 3], bad, name_row, problems)
    return Modes(count, values), np.flatnonzero(bad)


def _bad_mixtures(
    count: IntArray,
    owner: IntArray,
    weight: RealArray,
    known_bad: BoolArray,
    name_row: Callable[[int], str],
    problems: Problems,
) -> BoolArray:
    """Note the rows whose modes are none, too many, or do not sum to 1."""
    finite = np.where(np.isfinite(weight), weight, 0.0)
    total = np.bincount(owner, finite, minlength=len(count))
    wrong_count = (count < 1) | (count > limits.MAX_MODES)
    wrong = ~known_bad & (wrong_count | (np.abs(total - 1) > limits.WEIGHT_TOLERANCE))

    def describe(row: int) -> tuple[str, str]:
        if wrong_count[row]:
            found = f"{count[row]} modes; required: 1 to {limits.MAX_MODES}"
        else:
            found = f"weights that sum to {total[row]:.6g}; required: 1 within 0.001"
        return name_row(row), f"modes has {found}"

    problems.add_rows("MODES_INVALID", np.flatnonzero(wrong).tolist(), int(wrong.sum()), describe)
    return wrong
