"""Brings a submission's rows to plain arrays, and notes every value that they must not hold.

A column without a fault costs one minimum and one maximum; only another one is looked at row by
row, to name the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from pliant.evaluator.submission.problems import Problems
from pliant.spec.answers import MAX_MODES, MAX_POSITION_PX, MAX_SIGMA_PX, WEIGHT_TOLERANCE
from pliant.spec.arrays import BoolArray, IntArray, RealArray

# What a submission may contain, whichever protocol scores it.

MAX_SUBMISSION_BYTES: Final = 16 * 2**30
"""Largest file."""

MAX_EXCESS_ROWS: Final = 1_000_000
"""So many rows more than there are queries are still read, to name the superfluous ones."""

MAX_MATCHES_PER_PAIR: Final = 100_000
"""Largest number of keypoint matches of one image pair."""

MODE_FIELDS: Final = ("u", "v", "sigma", "weight")
_RANGES: Final = {
    "sigma": (0.0, MAX_SIGMA_PX, "greater than 0 and at most 1e6 px"),
    "visible": (0.0, 1.0, "a probability, 0 to 1"),
    "weight": (0.0, 1.0, "a weight, 0 to 1"),
}
_POSITION: Final = (
    -MAX_POSITION_PX,
    MAX_POSITION_PX,
    "a finite position within ±1e6 px",
)
_SCORE: Final = (-np.inf, np.inf, "a finite number")


@dataclass(frozen=True)
class Modes:
    """The mixtures of a submission.

    Attributes:
        count: int64 (N,), modes of each row.
        values: float32 or float64 (sum of count, 4): u, v, sigma, weight.
    """

    count: IntArray
    values: RealArray


@dataclass(frozen=True)
class Values:
    """The rows of a submission, in the order of the file.

    Attributes:
        keys: Integers (N,) by column name (`pair_id`, `query_id`); -1 stands for a null and for
            what no int64 holds.
        reals: float32 or float64 (N,) by column name.
        modes: The mixtures, or None.
        good: bool (N,), rows whose values may all be used, or None for all of them.
    """

    keys: dict[str, IntArray]
    reals: dict[str, RealArray]
    modes: Modes | None
    good: BoolArray | None


def read_values(table: pa.Table, columns: Mapping[str, str], problems: Problems) -> Values:
    """Return the rows of a submission, and note nulls, non-finite and out-of-range values.

    Args:
        table: The columns.
        columns: Name -> `integer`, `real`, `probability` or `modes`.
        problems: Receives what is wrong, with row numbers, ids, found and required.
    """
    checks = _Checks(table, problems)
    keys: dict[str, IntArray] = {}
    reals: dict[str, RealArray] = {}
    modes: Modes | None = None
    for name, kind in columns.items():
        array = _plain(table[name])
        if kind == "modes":
            of_modes = _Checks(table, problems)
            modes = _read_modes(array, of_modes)
            checks.refuse(~of_modes.good)
            continue
        null = array.is_null().to_numpy(zero_copy_only=False) if array.null_count else None
        if null is not None:
            checks.note("VALUE_NULL", null, f"{name} is null; required: a value")
        if kind == "integer":
            keys[name] = _integers(array)
        else:
            reals[name] = _reals(array)
            with np.errstate(invalid="ignore"):  # a signalling NaN warns of itself
                checks.note_values(name, name, reals[name], null)
    return Values(keys, reals, modes, checks.good if checks.any else None)


def _plain(column: pa.ChunkedArray) -> pa.Array:
    """Return a column as one array, its dictionaries decoded."""
    kind = column.type
    if pa.types.is_dictionary(kind):
        chunks = [chunk.dictionary_decode() for chunk in column.chunks]
        column = pa.chunked_array(chunks, kind.value_type)
    return pa.concat_arrays(column.chunks) if column.num_chunks else pa.array([], column.type)


class _Checks:
    """Notes what is wrong with rows.

    Attributes:
        good: bool (N,), rows whose values may be used.
        any: Whether a row may not be used.
    """

    def __init__(self, table: pa.Table, problems: Problems) -> None:
        self._table, self._problems = table, problems
        self._ids = [name for name in ("pair_id", "query_id") if name in table.schema.names]
        self.good = np.ones(table.num_rows, bool)
        self.any = False

    def refuse(self, wrong: BoolArray | IntArray) -> None:
        """Mark rows, given by a mask or their numbers, as not to be used."""
        self.good[wrong] = False
        self.any = not self.good.all()

    def note(
        self,
        code: str,
        wrong: BoolArray,
        message: str | Callable[[int], str],
        owner: IntArray | None = None,
    ) -> None:
        """Note wrong rows, or wrong modes of the rows `owner`; `message` may take their number."""
        if not wrong.any():
            return
        self.refuse(wrong if owner is None else owner[wrong])

        def describe(index: int) -> tuple[str, str]:
            row = index if owner is None else int(owner[index])
            text = message if isinstance(message, str) else message(index)
            ids = (f"{name[:-3]} {self._table[name][row].as_py()}" for name in self._ids)
            return f"row {row} ({', '.join(ids)})", text

        self._problems.add_rows(code, wrong, describe)

    def note_values(
        self,
        name: str,
        label: str,
        values: RealArray,
        null: BoolArray | None,
        owner: IntArray | None = None,
    ) -> None:
        """Note the values of one column that are not finite or out of range."""
        low, high, required = _SCORE if name == "score" else _RANGES.get(name, _POSITION)
        strict = name == "sigma"
        if not len(values):
            return
        smallest, largest = values.min(), values.max()  # NaN if there is one: nothing compares
        if (smallest > low if strict else smallest >= low) and largest <= high and largest < np.inf:
            return
        with np.errstate(invalid="ignore"):
            outside = (values <= low if strict else values < low) | (values > high)
        # Each has its own sentence, which names the value.
        kinds = (np.isnan, np.isposinf, np.isneginf)
        found = [("VALUE_NOT_FINITE", is_kind(values)) for is_kind in kinds]
        for code, wrong in (*found, ("VALUE_OUT_OF_RANGE", outside & np.isfinite(values))):
            if null is not None:
                wrong &= ~null
            self.note(
                code, wrong, lambda i: f"{label} is {values[i]!s}; required: {required}", owner
            )


def _integers(array: pa.Array) -> IntArray:
    if array.null_count:
        array = pc.fill_null(array, 0 if pa.types.is_unsigned_integer(array.type) else -1)
    result: npt.NDArray[Any] = array.to_numpy(zero_copy_only=False)
    if result.dtype == np.uint64:
        result = np.minimum(result, np.uint64(2**62))
    return result.astype(np.int64 if result.dtype.kind == "u" else result.dtype, copy=False)


def _reals(array: pa.Array) -> RealArray:
    if pa.types.is_boolean(array.type):
        array = array.cast(pa.float32())
    result: RealArray = array.to_numpy(zero_copy_only=False)  # a null becomes NaN
    return result


def _read_modes(array: pa.Array, checks: _Checks) -> Modes:
    """Read the mixtures of all rows."""
    rows = len(array)
    null = array.is_null().to_numpy(zero_copy_only=False)
    checks.note("VALUE_NULL", null, "modes is null; required: a list")
    count = pc.fill_null(pc.list_value_length(array), 0).to_numpy(zero_copy_only=False)
    count = np.where(null, 0, count.astype(np.int64))
    items = pc.list_flatten(array)
    owner = np.repeat(np.arange(rows), count)
    columns = []
    for name in MODE_FIELDS:
        field = pc.struct_field(items, name)
        if field.null_count:
            missing = field.is_null().to_numpy(zero_copy_only=False)
            checks.note(
                "VALUE_NULL",
                np.bincount(owner[missing], minlength=rows) > 0,
                f"modes holds a null {name}; required: a value",
            )
            field = pc.fill_null(field, 1.0)
        columns.append(_reals(field))
        checks.note_values(name, f"modes.{name}", columns[-1], None, owner)
    values = np.stack(columns, axis=1) if columns[0].size else np.zeros((0, 4), np.float32)
    _check_mixtures(count, owner, values[:, 3], checks)
    return Modes(count, values)


def _check_mixtures(count: IntArray, owner: IntArray, weight: RealArray, checks: _Checks) -> None:
    """Note the rows whose modes are none, too many, or do not sum to 1."""
    finite = np.where(np.isfinite(weight), weight, 0.0)
    total = np.bincount(owner, finite, minlength=len(count))
    wrong_count = (count < 1) | (count > MAX_MODES)
    wrong = checks.good & (wrong_count | (np.abs(total - 1) > WEIGHT_TOLERANCE))

    def message(row: int) -> str:
        if wrong_count[row]:
            return f"modes has {count[row]} modes; required: 1 to {MAX_MODES}"
        return f"modes has weights that sum to {total[row]:.6g}; required: 1 within 0.001"

    checks.note("MODES_INVALID", wrong, message)
