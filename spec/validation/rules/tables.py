"""Rules every table shares: footer, columns, and values read batch by batch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.io.jsonfiles import is_newer_minor, schema_errors
from pliant.spec.io.parquet import footer_of, open_table
from pliant.spec.io.parquet_columns import column_problem, load_batches, load_columns
from pliant.spec.opening import check_version
from pliant.spec.tables import TABLES
from pliant.spec.validation.findings import FileProblems


@dataclass(frozen=True)
class CheckedTable:
    """A Parquet file whose footer and columns were checked.

    Attributes:
        file: The open file.
        path: Where it is.
        problems: Gets its problems.
        name: Name of the table.
        whole: True if every declared column is there with its type.
        footer: Its `pliant` footer, empty if it has none that is valid.
    """

    file: pq.ParquetFile
    path: Path
    problems: FileProblems
    name: str
    whole: bool
    footer: Mapping[str, Any]

    @property
    def rows(self) -> int:
        """Number of rows, by the file's metadata."""
        return int(self.file.metadata.num_rows)

    def read(self) -> pa.Table | None:
        """Return all rows; None if they cannot be read, which is reported."""
        rows = None
        with self.problems.refusals():
            rows = load_columns(self.file, self.path, TABLES[self.name])
        return rows

    def batches(self, columns: list[str]) -> Iterator[tuple[int, pa.Table]]:
        """Yield (first row, rows) of some columns, a few at a time.

        `FILE_UNREADABLE` and `VALUE_NULL` are reported; the rows end there.

        Args:
            columns: Names of columns that are there.
        """
        start = 0
        schema = pa.schema([TABLES[self.name].field(name) for name in columns])
        with self.problems.refusals():
            for batch in load_batches(self.file, self.path, schema):
                yield start, batch
                start += batch.num_rows


def check_table(
    path: Path, name: str, problems: FileProblems, *, max_rows: int
) -> CheckedTable | None:
    """Open a table and check footer and columns.

    Args:
        path: The file.
        name: A key of `TABLES`.
        problems: Gets the problems.
        max_rows: The most rows allowed.

    Returns:
        The table, or None if it cannot be opened.
    """
    file = None
    with problems.refusals():
        file = open_table(path, max_rows=max_rows)
    if file is None:
        return None
    footer = _footer(file, path, name, problems)
    found = file.schema_arrow
    whole = True
    for field in TABLES[name]:
        problem = column_problem(found, field)
        if problem is not None:
            whole = False
            problems.add(problem[0], field.name, problem[1])
    unknown = () if is_newer_minor(footer.get("spec_version")) else set(found.names)
    for extra in sorted(set(unknown) - set(TABLES[name].names)):
        problems.add("COLUMN_EXTRA", extra[:80], "the specification has no such column")
    return CheckedTable(file, path, problems, name, whole, footer)


def _footer(file: pq.ParquetFile, path: Path, name: str, problems: FileProblems) -> dict[str, Any]:
    with problems.refusals():
        footer = footer_of(file, path)
        if isinstance(footer.get("spec_version"), str):
            check_version(footer["spec_version"], path)
        errors = list(schema_errors(footer, f"footer-{name}"))
        for where, message in errors:
            problems.add("FOOTER_INVALID", f"footer {where}".strip(), message)
        if not errors:
            return footer
    return {}


def check_place(table: CheckedTable) -> None:
    """Check that a footer's `sequence` and `tier`, where it has them, name the table's folders."""
    folder = table.path.parent
    for key, required in (("sequence", folder.name), ("tier", folder.parent.name)):
        named = table.footer.get(key, required)
        if named != required:
            text = f"found {named!r:.80}; its folder has {required!r:.80}"
            table.problems.add("IDENTITY_DIFFERS", f"footer {key}", text)


def numbers(table: pa.Table, column: str) -> npt.NDArray[Any]:
    """Return a numeric column as one array."""
    array: npt.NDArray[Any] = table.column(column).to_numpy()
    return array


def report_not_finite(
    table: pa.Table, columns: list[str], start: int, problems: FileProblems
) -> npt.NDArray[np.bool_]:
    """Report NaN and infinities; return which rows hold none.

    Args:
        table: The rows.
        columns: Float columns.
        start: Number of the first row.
        problems: Gets `VALUE_NOT_FINITE`.

    Returns:
        bool (N,), True for rows without any.
    """
    good = np.ones(table.num_rows, np.bool_)
    for column in columns:
        values = numbers(table, column)
        bad = ~np.isfinite(values)
        if bad.any():
            good &= ~bad
            problems.add_rows(
                "VALUE_NOT_FINITE",
                bad,
                lambda i, c=column, v=values: (f"row {start + i}, {c}", f"found {v[i]}"),  # type: ignore[misc]
            )
    return good
