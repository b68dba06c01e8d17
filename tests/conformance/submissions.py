"""Submissions to the dataset `full`: valid ones, and named ways of breaking them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.conventions import FOOTER_KEY, SPEC_VERSION
from pliant.spec.io.parquet import read_table
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage.layout import queries_path
from pliant.spec.tables import ANSWERS_OPTIONAL

SPLIT = "test"

Columns = dict[str, Any]
Footer = dict[str, Any]
Change = Callable[[Columns, Footer], Any]


@dataclass(frozen=True)
class SubmissionCase:
    """One named submission.

    Attributes:
        name: Unique; the file's name without its suffix.
        text: What it is.
        codes: The issue codes a check must report: these and no others.
        change: Changes the columns and the footer of a perfect submission in place; may
            return the bytes of the file instead.
        table: `answers` or `matches`.
    """

    name: str
    text: str
    codes: tuple[str, ...]
    change: Change
    table: str = "answers"


def perfect(dataset: Path, table: str) -> tuple[Columns, Footer]:
    """Return the columns and the footer of a submission that gives the truth.

    Args:
        dataset: The dataset `full`.
        table: `answers` or `matches`.
    """
    truth = read_table(dataset / "truth" / f"{SPLIT}.parquet", "truth")
    queries = read_table(queries_path(dataset, SPLIT), "queries")
    columns: Columns = {
        "pair_id": truth.column("pair_id").to_numpy().copy(),
        "u": truth.column("u_b").to_numpy().copy(),
        "v": truth.column("v_b").to_numpy().copy(),
    }
    if table == "answers":
        columns["query_id"] = truth.column("query_id").to_numpy().copy()
    else:
        columns["u_a"] = queries.column("u_a").to_numpy().copy()
        columns["v_a"] = queries.column("v_a").to_numpy().copy()
        columns["score"] = np.ones(len(queries), np.float32)
    footer = {
        "spec_version": SPEC_VERSION,
        "table": table,
        "dataset": {"id": "conformance-full", "version": "1.0.0"},
        "split": SPLIT,
        "queries_sha256": sha256_file(queries_path(dataset, SPLIT)),
        "method": {"name": "truth"},
    }
    return columns, footer


def write_submission(case: SubmissionCase, dataset: Path, path: Path) -> None:
    """Write the file of a case."""
    columns, footer = perfect(dataset, case.table)
    data = case.change(columns, footer)
    if isinstance(data, bytes):
        path.write_bytes(data)
        return
    metadata = {FOOTER_KEY: json.dumps(footer).encode()} if footer else {}
    pq.write_table(pa.table(columns).replace_schema_metadata(metadata), path)


def _nothing(columns: Columns, footer: Footer) -> None:
    return None


def _footer(**values: Any) -> Change:
    def change(columns: Columns, footer: Footer) -> None:
        footer.update(values)

    return change


def _no_field(name: str) -> Change:
    def change(columns: Columns, footer: Footer) -> None:
        del footer[name]

    return change


def _value(name: str, value: Any, row: int = 3) -> Change:
    def change(columns: Columns, footer: Footer) -> None:
        columns[name][row] = value

    return change


def _column(name: str, values: Callable[[int], Any]) -> Change:
    """Return a change that adds or replaces a column; it gets the number of rows."""

    def change(columns: Columns, footer: Footer) -> None:
        columns[name] = values(len(columns["pair_id"]))

    return change


def _floats(value: float) -> Callable[[int], Any]:
    return lambda count: np.full(count, value, np.float32)


def _one_float(value: float, other: float) -> Callable[[int], Any]:
    def values(count: int) -> Any:
        array = np.full(count, other, np.float32)
        array[3] = value
        return array

    return values


def _rows(pick: Callable[[int], Any]) -> Change:
    """Return a change that takes rows by index."""

    def change(columns: Columns, footer: Footer) -> None:
        index = pick(len(columns["pair_id"]))
        for name in columns:
            columns[name] = columns[name][index]

    return change


def _drop(name: str) -> Change:
    def change(columns: Columns, footer: Footer) -> None:
        del columns[name]

    return change


def _cast(name: str, kind: Any) -> Change:
    def change(columns: Columns, footer: Footer) -> None:
        columns[name] = columns[name].astype(kind)

    return change


def _text(columns: Columns, footer: Footer) -> None:
    columns["u"] = [str(value) for value in columns["u"]]


def _null(columns: Columns, footer: Footer) -> None:
    values: list[float | None] = columns["u"].tolist()
    values[3] = None
    columns["u"] = pa.array(values, pa.float32())


def _modes(*modes: tuple[float, float, float, float]) -> Callable[[int], Any]:
    """Return a column whose row 3 has the given modes (u, v, sigma, weight)."""
    good = [{"u": 1.0, "v": 2.0, "sigma": 3.0, "weight": 1.0}]
    odd = [dict(zip(("u", "v", "sigma", "weight"), mode, strict=True)) for mode in modes]

    def values(count: int) -> Any:
        rows = [good] * count
        rows[3] = odd
        return pa.array(rows, ANSWERS_OPTIONAL.field("modes").type)

    return values


def _sigma_and_modes(columns: Columns, footer: Footer) -> None:
    columns["sigma"] = np.ones(len(columns["pair_id"]), np.float32)
    columns["modes"] = _modes((1, 2, 3, 1))(len(columns["pair_id"]))


def _no_footer(columns: Columns, footer: Footer) -> None:
    footer.clear()


def _csv(columns: Columns, footer: Footer) -> bytes:
    return b"pair_id,query_id,u,v\n0,0,1.5,2.5\n"


def _truncated(columns: Columns, footer: Footer) -> bytes:
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(columns), sink)
    data: bytes = sink.getvalue().to_pybytes()
    return data[: len(data) // 2]


def _empty_file(columns: Columns, footer: Footer) -> bytes:
    return b""


_TWO = ((10.0, 20.0, 2.0, 0.25), (30.0, 40.0, 4.0, 0.75))

CASES = [
    SubmissionCase("perfect", "the truth", (), _nothing),
    SubmissionCase(
        "shuffled",
        "the rows in another order",
        (),
        _rows(lambda n: np.random.default_rng(0).permutation(n)),
    ),
    SubmissionCase("outside-image", "a position outside the image", (), _value("u", -40.0)),
    SubmissionCase(
        "extra-column", "a column that is not known", (), _column("note", lambda n: ["x"] * n)
    ),
    SubmissionCase("with-visible", "with visible", (), _column("visible", _floats(0.5))),
    SubmissionCase("with-sigma", "with sigma", (), _column("sigma", _floats(2.0))),
    SubmissionCase(
        "with-modes", "with modes, two of them in one row", (), _column("modes", _modes(*_TWO))
    ),
    SubmissionCase("matches", "keypoint matches", (), _nothing, "matches"),
    SubmissionCase(
        "matches-few",
        "keypoint matches for one pair alone",
        (),
        _rows(lambda n: np.arange(2)),
        "matches",
    ),
    SubmissionCase("no-footer", "without a footer", ("FOOTER_MISSING",), _no_footer),
    SubmissionCase(
        "footer-no-method", "the footer lacks the method", ("FOOTER_INVALID",), _no_field("method")
    ),
    SubmissionCase(
        "footer-other-table",
        "the footer calls it the truth",
        ("FOOTER_INVALID",),
        _footer(table="truth"),
    ),
    SubmissionCase(
        "version-2",
        "of specification 2.0.0",
        ("SPEC_VERSION_UNSUPPORTED",),
        _footer(spec_version="2.0.0"),
    ),
    SubmissionCase(
        "other-dataset",
        "to another dataset",
        ("DATASET_MISMATCH",),
        _footer(dataset={"id": "another", "version": "1.0.0"}),
    ),
    SubmissionCase(
        "other-version",
        "to another version of the dataset",
        ("DATASET_MISMATCH",),
        _footer(dataset={"id": "conformance-full", "version": "1.1.0"}),
    ),
    SubmissionCase(
        "other-queries",
        "with another sha256 of the queries",
        ("QUERIES_MISMATCH",),
        _footer(queries_sha256="0" * 64),
    ),
    SubmissionCase("column-missing", "without v", ("COLUMN_MISSING",), _drop("v")),
    SubmissionCase("column-float64", "u is float64", (), _cast("u", np.float64)),
    SubmissionCase("column-text", "u is text", ("COLUMN_TYPE",), _text),
    SubmissionCase("keys-int64", "pair_id is int64", (), _cast("pair_id", np.int64)),
    SubmissionCase(
        "row-missing", "a query has no answer", ("ROW_MISSING",), _rows(lambda n: np.arange(n - 1))
    ),
    SubmissionCase("no-rows", "no row at all", ("ROW_MISSING",), _rows(lambda n: np.arange(0))),
    SubmissionCase(
        "row-twice",
        "a query has two answers",
        ("ROW_DUPLICATE",),
        _rows(lambda n: np.array([*range(n), 3])),
    ),
    SubmissionCase(
        "row-unknown",
        "an answer to no query takes the place of one",
        ("ROW_MISSING", "ROW_UNKNOWN"),
        _value("query_id", 99),
    ),
    SubmissionCase("nan", "u is NaN", ("VALUE_NOT_FINITE",), _value("u", math.nan)),
    SubmissionCase("infinite", "v is infinite", ("VALUE_NOT_FINITE",), _value("v", math.inf)),
    SubmissionCase("null", "u is null", ("VALUE_NULL",), _null),
    SubmissionCase(
        "visible-above-1",
        "visible is 1.5",
        ("VALUE_OUT_OF_RANGE",),
        _column("visible", _one_float(1.5, 0.5)),
    ),
    SubmissionCase(
        "sigma-zero", "sigma is 0", ("VALUE_OUT_OF_RANGE",), _column("sigma", _one_float(0.0, 1.0))
    ),
    SubmissionCase(
        "sigma-nan",
        "sigma is NaN",
        ("VALUE_NOT_FINITE",),
        _column("sigma", _one_float(math.nan, 1.0)),
    ),
    SubmissionCase(
        "modes-empty", "a row has no modes", ("MODES_INVALID",), _column("modes", _modes())
    ),
    SubmissionCase(
        "modes-sum",
        "the weights of a row sum to 0.9",
        ("MODES_INVALID",),
        _column("modes", _modes((1, 2, 3, 0.9))),
    ),
    SubmissionCase("sigma-and-modes", "sigma beside modes", ("MODES_INVALID",), _sigma_and_modes),
    SubmissionCase("not-parquet", "a CSV file", ("FILE_UNREADABLE",), _csv),
    SubmissionCase("truncated", "half of a file", ("FILE_UNREADABLE",), _truncated),
    SubmissionCase("empty", "a file of no bytes", ("FILE_UNREADABLE",), _empty_file),
    SubmissionCase(
        "matches-no-score",
        "matches without a score",
        ("COLUMN_MISSING",),
        _drop("score"),
        "matches",
    ),
    SubmissionCase(
        "matches-nan", "a match at NaN", ("VALUE_NOT_FINITE",), _value("u_a", math.nan), "matches"
    ),
    SubmissionCase(
        "matches-unknown-pair",
        "a match of a pair that is not asked",
        ("ROW_UNKNOWN",),
        _value("pair_id", 77),
        "matches",
    ),
]
"""Every submission."""
