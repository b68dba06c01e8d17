"""Opens a submission without trusting it: the file, its footer and its columns."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from pliant.evaluator.submission.problems import Problems
from pliant.evaluator.submission.queries import Queries
from pliant.evaluator.submission.values import (
    MAX_EXCESS_ROWS,
    MAX_MATCHES_PER_PAIR,
    MAX_SUBMISSION_BYTES,
    MODE_FIELDS,
)
from pliant.spec.conventions import SPEC_VERSION
from pliant.spec.dataset import Dataset
from pliant.spec.io.jsonfiles import schema_errors
from pliant.spec.io.parquet import footer_of
from pliant.spec.io.reading import FileRefusedError
from pliant.spec.opening import check_version
from pliant.spec.text import name_fault, shortened

_KEYS: Final = {"pair_id": "integer", "query_id": "integer"}
REQUIRED: Final[dict[str, dict[str, str]]] = {
    "answers": {**_KEYS, "u": "real", "v": "real"},
    "matches": {
        "pair_id": "integer",
        **dict.fromkeys(("u_a", "v_a", "u", "v", "score"), "real"),
    },
}
OPTIONAL: Final[dict[str, dict[str, str]]] = {
    "answers": {"visible": "probability", "sigma": "real", "modes": "modes"},
    "matches": {},
}
_WANTED: Final = {
    "integer": "an integer type",
    "real": "float32 or float64",
    "probability": "float32, float64 or bool",
    "modes": "list<struct<u, v, sigma, weight>> of float32 or float64",
}


@dataclass(frozen=True)
class Submission:
    """A submission whose file, footer and columns may be used.

    Attributes:
        name: Name of the file, without its folder.
        kind: `answers` or `matches`.
        footer: The footer object.
        columns: The columns to read, by name: `integer`, `real`, `probability` or `modes`.
        rows: Number of rows.
        sha256: Of the file.
    """

    name: str
    kind: str
    footer: Mapping[str, Any]
    columns: Mapping[str, str]
    rows: int
    sha256: str = ""

    @property
    def split(self) -> str:
        """The split it answers."""
        return str(self.footer["split"])


def open_submission(
    path: Path, dataset: Dataset, problems: Problems
) -> tuple[Submission, pq.ParquetFile] | None:
    """Open a submission; everything that is wrong with it goes to `problems`.

    Args:
        path: The file.
        dataset: The dataset it must answer.
        problems: Receives the problems of the file, its footer and its columns.

    Returns:
        The submission without its sha256, and its file; None where its rows cannot be read or
        matched with queries.
    """
    file = _open(path, problems)
    if file is None:
        return None
    footer = _footer(file, path, dataset, problems)
    kind = None if footer is None else str(footer["table"])
    columns = check_columns(file.schema_arrow, kind or "answers", problems)
    if footer is None or kind is None or columns is None:
        return None
    return Submission(path.name, kind, footer, columns, file.metadata.num_rows), file


def read_rows(
    submission: Submission, file: pq.ParquetFile, queries: Queries, problems: Problems
) -> pa.Table | None:
    """Decode the columns of a submission, or None where they are damaged or far too many."""
    required, most = f"{queries.rows:,}, one for each query", queries.rows
    if submission.kind == "matches":
        most = queries.pairs * MAX_MATCHES_PER_PAIR
        required = f"at most {most:,}, {MAX_MATCHES_PER_PAIR:,} for each image pair"
    if submission.rows > most + MAX_EXCESS_ROWS:
        found = f"found {submission.rows:,} rows; required: {required}"
        problems.add_many("ROW_UNKNOWN", submission.rows - most, [("", found)])
        return None
    try:
        table = file.read(list(submission.columns), use_threads=False)
        table.validate(full=True)
    except MemoryError:
        raise  # the limit of the child process
    except Exception as error:  # Arrow's errors on a hostile file do not share a base
        problems.add("FILE_UNREADABLE", "", f"the rows cannot be decoded: {_short(error)}")
        return None
    if len(table) != submission.rows:
        problems.add(
            "FILE_UNREADABLE",
            "",
            f"found {len(table):,} rows; its footer announces {submission.rows:,}",
        )
        return None
    return table


def _open(path: Path, problems: Problems) -> pq.ParquetFile | None:
    try:
        resolved = path.resolve(strict=True)
        regular = resolved.is_file()
        size = resolved.stat().st_size
    except (OSError, ValueError, RuntimeError):
        problems.add("FILE_MISSING", "", "the file is not there; give the path of a Parquet file")
        return None
    if not regular:
        problems.add(
            "FILE_UNREADABLE", "", "this is a folder or a special file, not a Parquet file"
        )
        return None
    if size > MAX_SUBMISSION_BYTES:
        required = f"at most {MAX_SUBMISSION_BYTES:,}"
        problems.differs("FILE_TOO_LARGE", "", f"{size:,} bytes", required)
        return None
    try:
        file = pq.ParquetFile(resolved, pre_buffer=False)
        _ = file.schema_arrow.names
    except Exception as error:  # Arrow's errors on a hostile file do not share a base
        text = kind_of_file(resolved) or f"the Parquet file cannot be decoded: {_short(error)}"
        problems.add("FILE_UNREADABLE", "", text)
        return None
    return file


def _footer(
    file: pq.ParquetFile, path: Path, dataset: Dataset, problems: Problems
) -> Mapping[str, Any] | None:
    """Return the footer, or None where it does not say which queries the rows answer."""
    try:
        footer = footer_of(file, path)
    except FileRefusedError as error:
        text = _short(error.without_place())
        if error.code == "FOOTER_MISSING":
            text = (
                "the file does not say which queries it answers: it has no entry `pliant` in its "
                f"metadata. {ADVICE}"
            )
        problems.add(error.code, error.where or "", text)
        return None
    try:
        check_version(footer.get("spec_version"), path)
    except FileRefusedError as error:
        found = footer.get("spec_version")
        three = isinstance(found, str) and re.fullmatch(r"\d+\.\d+\.\d+", found)
        problems.add(
            error.code,
            "footer spec_version",
            _short(error.without_place())
            if three
            else f"found {found!r:.40}; required: text of three numbers, such as {SPEC_VERSION!r}",
        )
        return None
    table = footer.get("table")
    if not isinstance(table, str) or table not in REQUIRED:
        required = " or ".join(REQUIRED)
        problems.differs("FOOTER_INVALID", "footer table", f"{table!r:.80}", required)
        return None
    broken = list(schema_errors(footer, f"footer-{table}"))
    if broken:
        for where, message in broken:
            problems.add("FOOTER_INVALID", f"footer {where}".strip(), message)
        return None
    fault = name_fault(footer["method"]["name"])
    if fault is not None:
        required = "a name that can be read, without control or zero-width characters"
        problems.differs("FOOTER_INVALID", "footer method.name", fault, required)
        return None
    checks: list[tuple[str, str, Any, Any, str]] = [
        ("DATASET_MISMATCH", f"dataset.{field}", footer["dataset"][field], value,
         f"{value!r}, the dataset at {dataset.root}")
        for field, value in (("id", dataset.id), ("version", dataset.version))
    ]  # fmt: skip
    splits = dataset.splits_with_queries()
    split, queries = footer["split"], footer["queries_sha256"]
    if split in splits:
        sha256 = dataset.queries_sha256(split)
        fix = "the answers belong to other queries: predict again with this dataset"
        checks.append(("QUERIES_MISMATCH", "queries_sha256", queries, sha256, f"{sha256}; {fix}"))
    else:
        one_of = f"one of {', '.join(splits) or 'none'}"
        checks.append(("SPLIT_MISMATCH", "split", split, None, one_of))
    wrong = [check for check in checks if check[2] != check[3]]
    for code, field, found, _, required in wrong:
        problems.differs(code, f"footer {field}", f"{found!r:.80}", required)
    return None if wrong else footer


def check_columns(schema: pa.Schema, kind: str, problems: Problems) -> dict[str, str] | None:
    """Return the columns to read and their types, or None where one is missing or wrong."""
    columns: dict[str, str] = {}
    fine = True
    for name, wanted in (REQUIRED[kind] | OPTIONAL[kind]).items():
        count = schema.names.count(name)
        if count == 0:
            if name in REQUIRED[kind]:
                fine = False
                present = ", ".join(schema.names[:20])
                given = f"the columns {present[:300] or 'none'}"
                problems.differs("COLUMN_MISSING", name, given, f"{name}, {_WANTED[wanted]}")
            continue
        if count > 1:
            fine = False
            problems.differs("COLUMN_TYPE", name, f"{count} columns of this name", "one")
            continue
        found = schema.field(name).type
        if _accepts(wanted, found):
            columns[name] = wanted
        else:
            fine = False
            problems.differs("COLUMN_TYPE", name, str(found)[:120], _WANTED[wanted])
    if "sigma" in columns and "modes" in columns:
        fine = False
        problems.add("MODES_INVALID", "sigma, modes", "found both; required: one of them or none")
    return columns if fine else None


def _accepts(wanted: str, found: pa.DataType) -> bool:
    """Return whether a column can be read as `wanted` without losing anything."""
    types = pa.types
    if types.is_dictionary(found):
        return wanted != "modes" and _accepts(wanted, found.value_type)
    if wanted == "integer":
        return bool(types.is_integer(found))
    real = types.is_float32(found) or types.is_float64(found)
    if wanted == "real":
        return bool(real)
    if wanted == "probability":
        return bool(real or types.is_boolean(found))
    listed = types.is_list(found) or types.is_large_list(found) or types.is_fixed_size_list(found)
    if not listed or not types.is_struct(found.value_type):
        return False
    fields = list(found.value_type)
    names = [field.name for field in fields]
    return all(
        names.count(name) == 1 and _accepts("real", fields[names.index(name)].type)
        for name in MODE_FIELDS
    )


def _short(text: object) -> str:
    return shortened(" ".join(str(text).split()), 400)


ADVICE: Final = (
    "Submissions are Parquet files with a footer. A table of answers (CSV, JSON lines, Parquet) "
    "becomes one by: pliant submission ANSWERS --data DATA --out SUB.parquet"
)
_STARTS: Final = {
    b"PK\x03\x04": "a zip archive (or npz, xlsx)",
    b"\x1f\x8b": "a gzip archive",
    b"\x93NUMPY": "a NumPy .npy file",
    b"\x89HDF": "an HDF5 file",
    b"ARROW1": "an Arrow (Feather) file",
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"\x80\x04\x95": "a Python pickle",
}


def kind_of_file(path: Path) -> str | None:
    """Return a sentence that says what a file is, if it is another kind that we recognise.

    Args:
        path: A regular file.
    """
    try:
        with open(path, "rb") as stream:
            start = stream.read(4096)
    except OSError:
        return None
    if not start:
        return f"the file is empty. {ADVICE}"
    for magic, kind in _STARTS.items():
        if start.startswith(magic):
            return f"this is {kind}. {ADVICE}"
    try:
        text = start.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if error.reason != "unexpected end of data":
            return None
        text = start[: error.start].decode("utf-8-sig")
    if not text.isprintable() and not re.fullmatch(r"[^\x00-\x08\x0e-\x1f\x7f]*", text):
        return None
    if text.lstrip().startswith(("{", "[")):
        return f"this is a JSON file. {ADVICE}"
    line = next(iter(text.splitlines()), "")
    if line.count(",") or line.count(";") or line.count("\t"):
        return f"this is a CSV file. {ADVICE}"
    return f"this is a text file. {ADVICE}"
