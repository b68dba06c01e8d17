"""Submissions made of a table that any program can write: CSV, TSV, JSON lines, plain Parquet."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq

from pliant.baselines.submission_file import (
    Kind,
    check_method_name,
    check_split,
    check_writable,
    query_keys,
    submission_footer,
)
from pliant.spec.answers import MAX_POSITION_PX, MAX_SIGMA_PX
from pliant.spec.arrays import BoolArray, IntArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.io.parquet import write_table
from pliant.spec.text import number_in

_KEYS: Final = ("pair_id", "query_id")
_POSITIONS: Final = ("u", "v", "u_a", "v_a")
_COLUMNS: Final[dict[Kind, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    "answers": (("u", "v"), ("visible", "sigma")),
    "matches": (("pair_id", "u_a", "v_a", "u", "v", "score"), ()),
}
"""Kind -> columns that are required, and optional ones, in addition to the keys of answers."""

_SEPARATORS: Final = {".csv": (",", ";", "\t"), ".tsv": ("\t",)}
_JSON_LINES: Final = (".jsonl", ".ndjson", ".json")
_PARQUET: Final = (".parquet", ".pq")
_BOOLEANS: Final = {
    word: value for value in (False, True) for word in (str(value), str(value).lower())
}
"""How pandas and JSON write `visible`."""

_REQUIRED: Final = {
    **dict.fromkeys(_KEYS, "a whole number"),
    "visible": "a probability, 0 to 1, or True or False",
    "score": "a finite number",
    "sigma": "a number greater than 0 and at most 1e6, px",
}
_SHOWN: Final = 40
"""Characters of a wrong value that a message shows."""


def submission_of_file(
    path: Path,
    dataset: Dataset,
    split: str,
    out: Path,
    kind: Kind = "answers",
    *,
    name: str,
    allow_missing: bool = False,
) -> tuple[int, list[str]]:
    """Write a submission of the answers in a file.

    Args:
        path: CSV, TSV, JSON lines or Parquet, by its suffix.
        dataset: The dataset.
        split: One of its splits with queries.
        out: Where to; an earlier submission there is replaced.
        kind: `answers` or `matches`.
        name: The method's name.
        allow_missing: Accept queries without an answer.

    Returns:
        The rows written, and the columns of the file that a submission does not have.

    Raises:
        CallError: The file, its format, its columns or the output cannot be used.
        SubmissionError: A value is not a finite number, or the rows do not answer the queries.
    """
    check_split(dataset, split)
    check_method_name(name)
    check_writable(out)
    table, first = _read(path)
    numbers, unused = _numbers(path, table, kind, first)
    keys = query_keys(dataset, split)
    if kind == "answers":
        asked = np.stack([keys.pair_id, keys.query_id], axis=1).astype(np.int64)
        order = _order(path, numbers, asked, first, allow_missing)
        given = {column: values[order] for column, values in numbers.items()}
        missing = {column: asked[:, n] for n, column in enumerate(_KEYS) if column not in given}
        numbers = {**missing, **given}
    else:
        known = np.isin(numbers["pair_id"], keys.pair_id)
        _refuse(path, "there is no such pair", numbers, ~known, first, ("pair_id",))
        order = np.argsort(numbers["pair_id"], kind="stable")
        numbers = {column: values[order] for column, values in numbers.items()}
    types = {column: pa.int32() if column in _KEYS else pa.float32() for column in numbers}
    columns = {column: pa.array(values).cast(types[column]) for column, values in numbers.items()}
    footer = submission_footer(dataset, split, {"name": name})
    write_table(out, pa.table(columns), kind, footer)
    return len(order), unused


def _read(path: Path) -> tuple[pa.Table, int]:
    """Return a file's columns and the number of its first row: lines of a text, else rows.

    Columns of a CSV file are text.
    """
    suffix = path.suffix.lower()
    if not path.is_file():
        raise CallError("file not found", path=path)
    try:
        if suffix in _PARQUET:
            table = pq.read_table(path)
            table.validate(full=True)  # text that is not UTF-8 is an error here, not later
            return table.rename_columns(table.column_names), 0  # and so are such names
        if suffix in _SEPARATORS:
            return _read_separated(path, _SEPARATORS[suffix]), 2
        if suffix in _JSON_LINES:
            rows = list(_json_rows(path))
            names = dict.fromkeys(chain.from_iterable(rows))  # those of the first row, and others
            return pa.Table.from_pylist(rows, pa.schema([(n, pa.string()) for n in names])), 1
    except (pa.ArrowException, OSError, UnicodeError) as error:
        raise CallError(
            "the file cannot be read",
            path=path,
            found=" ".join(str(error).split())[:200],
            required="a Parquet file"
            if suffix in _PARQUET
            else "UTF-8 text with a header and as many values in every row"
            if suffix in _SEPARATORS
            else "UTF-8 text",
        ) from error
    raise CallError(
        "this is not a table of answers that can be read",
        path=path,
        found=suffix or "no suffix",
        required="a .csv, .tsv, .jsonl or .parquet file",
    )


def _read_separated(path: Path, separators: tuple[str, ...]) -> pa.Table:
    with path.open(encoding="utf-8-sig") as file:
        header = file.readline(65_536)
    separator = max(separators, key=header.count)
    names = [each.strip().strip('"') for each in header.rstrip("\r\n").split(separator)]
    size = path.stat().st_size
    return pyarrow.csv.read_csv(
        path,
        read_options=pyarrow.csv.ReadOptions(
            column_names=names, skip_rows=1, use_threads=False, block_size=min(max(size, 1), 2**30)
        ),
        parse_options=pyarrow.csv.ParseOptions(delimiter=separator),
        convert_options=pyarrow.csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string())),
    )


def _json_rows(path: Path) -> Iterator[dict[str, Any]]:
    with path.open(encoding="utf-8-sig") as file:
        for number, line in enumerate(file, start=1):
            if line.isspace():  # ignored as in CSV
                continue
            try:
                row = json.loads(line)
            except (ValueError, RecursionError):
                row = None
            if not isinstance(row, dict):
                raise CallError(
                    "this is not JSON lines",
                    path=path,
                    where=f"line {number}",
                    found=_short(line.strip()),
                    required='an object in each line, such as {"u": 1.5, "v": 2.5}',
                )
            yield {key: None if value is None else str(value) for key, value in row.items()}


def _numbers(
    path: Path, table: pa.Table, kind: Kind, first: int
) -> tuple[dict[str, npt.NDArray[Any]], list[str]]:
    """Return the columns of a submission as int64 and float64, and the names of the others."""
    required, optional = _COLUMNS[kind]
    keys = _KEYS if kind == "answers" else ("pair_id",)
    names = table.column_names
    absent = [column for column in required if column not in names]
    given = [column for column in keys if column in names]
    if absent or len(given) == 1 < len(keys) or len(set(names)) < len(names):
        raise CallError(
            "the columns are not those of a submission",
            path=path,
            found=_short(", ".join(names)) or "no columns",
            required=f"{', '.join(required)}; both or neither of pair_id and query_id"
            if kind == "answers"
            else ", ".join(required),
        )
    wanted = [column for column in names if column in (*keys, *required, *optional)]
    found = {column: _number(path, table.column(column), column, first) for column in wanted}
    return found, [column for column in names if column not in wanted]


def _number(path: Path, column: pa.ChunkedArray, name: str, first: int) -> npt.NDArray[Any]:
    """Return a column as float64, or int64 for a key; the first wrong value is an error."""
    kind = column.type
    if name in _POSITIONS and (pa.types.is_integer(kind) or pa.types.is_float16(kind)):
        raise SubmissionError(
            "positions of this type lose up to half a pixel",
            path=path,
            where=f"column {name}",
            found=kind,
            required="float32 or float64",
            fix="The centre of the first pixel is at (0.5, 0.5): add 0.5 to a column or row number",
        )
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        column = pc.utf8_trim_whitespace(column)
    try:
        values = column.cast(pa.float64()).to_numpy()
    except pa.ArrowException:
        words = _BOOLEANS if name == "visible" else {}
        values = np.array([_float(value, words) for value in column.to_pylist()])
    with np.errstate(over="ignore", invalid="ignore"):
        right = np.isfinite(values.astype(np.float32))
        if name in _KEYS:
            right &= (values == np.rint(values)) & (np.abs(values) < 2**31)
        elif name == "visible":
            right &= (values >= 0) & (values <= 1)
        elif name == "sigma":
            right &= (values > 0) & (values <= MAX_SIGMA_PX)
        elif name in _POSITIONS:
            right &= np.abs(values) <= MAX_POSITION_PX
    if not right.all():
        row = int(np.argmin(right))
        raise SubmissionError(
            "a value is missing or wrong",
            path=path,
            where=f"{_row(path, row, first)}, column {name}",
            found=_short(repr(column[row].as_py())),
            required=_REQUIRED.get(name, "a finite number within ±1e6, such as 320.5"),
        )
    return values.astype(np.int64) if name in _KEYS else values


def _float(value: Any, words: dict[str, bool]) -> float:
    text = str(value)
    try:
        return float(words[text]) if text in words else number_in(text)
    except ValueError:
        return float("nan")


def _order(
    path: Path,
    numbers: dict[str, npt.NDArray[Any]],
    asked: IntArray,
    first: int,
    allow_missing: bool,
) -> IntArray:
    """Return the row that answers each query, in the order of the queries."""
    count = len(numbers["u"])
    if "pair_id" not in numbers:
        if count != len(asked):
            raise SubmissionError(
                "without pair_id and query_id, the file must have one row per query",
                path=path,
                found=f"{count} rows",
                required=f"{len(asked)}, in the order of the queries file",
            )
        return np.arange(count)
    given = numbers["pair_id"] * 2**32 + numbers["query_id"]
    queries = asked[:, 0] * 2**32 + asked[:, 1]
    _refuse(path, "there is no such query", numbers, ~np.isin(given, queries), first, _KEYS)
    order = np.argsort(given, kind="stable")
    again = np.zeros(count, np.bool_)
    again[order[1:]] = np.diff(given[order]) == 0
    _refuse(path, "this query is answered again", numbers, again, first, _KEYS)
    answered = np.isin(queries, given)
    if not answered.all() and not allow_missing:
        pair, query = asked[int(np.argmin(answered))]
        raise SubmissionError(
            "queries have no answer",
            path=path,
            found=f"{count} of {len(asked)}, none for pair_id {pair}, query_id {query}",
            required="one row per query",
            fix="Answer every query, or use --allow-missing",
        )
    return order[np.searchsorted(given[order], queries[answered])]


def _refuse(
    path: Path,
    message: str,
    numbers: dict[str, npt.NDArray[Any]],
    wrong: BoolArray,
    first: int,
    keys: tuple[str, ...],
) -> None:
    if wrong.any():
        row = int(np.argmax(wrong))
        found = ", ".join(f"{key} {numbers[key][row]}" for key in keys)
        total = f" (and {wrong.sum() - 1} more)" if wrong.sum() > 1 else ""
        raise SubmissionError(
            message, path=path, where=_row(path, row, first), found=f"{found}{total}",
            required="the ids of the queries file, each once",
        )  # fmt: skip


def _row(path: Path, row: int, first: int) -> str:
    """Return the place of a row; in a text it is a line, and empty lines are not rows."""
    if not first:
        return f"row {row}"
    empty = None if path.suffix.lower() in _JSON_LINES else "\r\n"  # blanks alone: a row of a CSV
    with path.open(encoding="utf-8-sig") as file:
        lines = (number for number, line in enumerate(file, start=1) if line.strip(empty))
        return f"line {next(islice(lines, row + first - 1, None))}"


def _short(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}… ({len(text)} characters)"
