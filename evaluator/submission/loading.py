"""Opens, checks and reads a submission, the same way for a check and for its scores.

A file from a stranger is read in a child process with limits on memory and time: a crash of the
Parquet library, or a file that expands without end, is an issue like any other. Answers that are
arrays in memory are checked like the rows of a file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa

from pliant.evaluator.submission.answers import (
    PlacedAnswers,
    PlacedMatches,
    coordinate_hints,
    place_answers,
    place_matches,
)
from pliant.evaluator.submission.problems import Problems
from pliant.evaluator.submission.queries import Queries, read_queries
from pliant.evaluator.submission.submission_file import (
    Submission,
    check_columns,
    open_submission,
    read_rows,
)
from pliant.evaluator.submission.values import read_values
from pliant.spec.arrays import RealArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, Issue
from pliant.spec.io.reading import sha256_file
from pliant.spec.limits import LimitError, Limits, run_limited
from pliant.spec.text import plural

Given: TypeAlias = "pa.Table | Mapping[str, Any] | RealArray"
"""Answers in memory: a table, columns by name, or the positions alone."""


@dataclass(frozen=True)
class Loaded:
    """A submission in which nothing is wrong.

    Attributes:
        submission: The file, its footer and columns.
        queries: The queries it answers.
        answers: Its rows in the order of the queries, or its keypoint matches by pair.
    """

    submission: Submission
    queries: Queries
    answers: PlacedAnswers | PlacedMatches


def load(
    path: Path,
    dataset: Dataset,
    problems: Problems,
    *,
    allow_missing: bool = False,
    limits: Limits | None = None,
) -> Loaded | None:
    """Open, check and read a submission.

    Args:
        path: The file.
        dataset: The dataset it answers.
        problems: Receives everything that is wrong.
        allow_missing: Whether a query without an answer is not a problem.
        limits: Read the file in a child process with these limits; None reads it in this process,
            which a hostile file can crash.

    Returns:
        The submission, or None if there is a problem.

    Raises:
        SpecError: The dataset is at fault, not the submission.
    """
    read = partial(_load, path, dataset, str(problems.path), allow_missing=allow_missing)
    try:
        loaded, found = read() if limits is None else run_limited(read, limits=limits, path=path)
    except LimitError as error:
        code = "FILE_UNREADABLE" if error.reason == "crash" else "FILE_TOO_LARGE"
        message = error.message
        for word, value in (("found", error.found), ("required", error.required)):
            message += f"; {word} {value}" if value is not None else ""
        problems.add(code, "", message)
        return None
    problems.include(found)
    return loaded


def _load(
    path: Path, dataset: Dataset, shown: str, *, allow_missing: bool
) -> tuple[Loaded | None, Problems]:
    problems = Problems(shown)
    opened = open_submission(path, dataset, problems)
    if opened is None:
        return None, problems
    submission, file = opened
    queries = read_queries(dataset, submission.split)
    table = read_rows(submission, file, queries, problems)
    if table is None:
        return None, problems
    loaded = _placed(submission, table, queries, problems, allow_missing=allow_missing)
    if loaded is not None:
        loaded = replace(loaded, submission=replace(submission, sha256=sha256_file(path)))
    return loaded, problems


def _placed(
    submission: Submission,
    table: pa.Table,
    queries: Queries,
    problems: Problems,
    *,
    allow_missing: bool,
) -> Loaded | None:
    values = read_values(table, submission.columns, problems)
    answers: PlacedAnswers | PlacedMatches
    if submission.kind == "matches":
        answers = place_matches(values, queries, problems)
    else:
        answers = place_answers(values, queries, problems, allow_missing=allow_missing)
    return None if problems else Loaded(submission, queries, answers)


def load_in_memory(
    answers: Given,
    dataset: Dataset,
    split: str,
    method: str,
    problems: Problems,
    *,
    allow_missing: bool,
) -> Loaded | None:
    """Check and read answers that are arrays.

    Args:
        answers: A table, a data frame or a mapping with the columns of a submission, each one value
            per row, or the positions alone, float (R, 2), pixels. Without `pair_id` and `query_id`
            the rows are in the order of the queries.
        dataset: The dataset.
        split: The split that is answered.
        method: Name of the method.
        problems: Receives everything that is wrong.
        allow_missing: Whether a query without an answer is not a problem.

    Returns:
        The answers as a submission, or None if there is a problem.

    Raises:
        CallError: The split has no queries, or the answers are not columns.
        SpecError: The dataset is at fault.
    """
    splits = dataset.splits_with_queries()
    if split not in splits:
        required = "one of " + ", ".join(splits)
        raise CallError("this split has no queries", found=repr(split), required=required)
    queries = read_queries(dataset, split)
    table = _with_keys(_table(answers), queries)
    columns = check_columns(table.schema, "answers", problems)
    if columns is None:
        return None
    used = table.select(list(columns))
    sha256 = dataset.queries_sha256(split)
    footer = {"split": split, "queries_sha256": sha256, "method": {"name": method}}
    submission = Submission(
        "answers in memory", "answers", footer, columns, len(used), _sha256(used)
    )
    return _placed(submission, used, queries, problems, allow_missing=allow_missing)


def _with_keys(table: pa.Table, queries: Queries) -> pa.Table:
    """Return a table with `pair_id` and `query_id`, of rows in the queries' order without them."""
    if {"pair_id", "query_id"} & set(table.column_names):
        return table
    if len(table) != queries.rows:
        raise CallError(
            "answers without pair_id and query_id must be one per query, in their order",
            found=f"{len(table):,} answers",
            required=f"{queries.rows:,}, the queries of split {queries.split}",
        )
    pair = np.repeat(np.arange(queries.pairs), np.diff(queries.starts))
    query = np.arange(queries.rows) - queries.starts[pair]
    keyed = table.append_column("pair_id", pa.array(pair))
    return keyed.append_column("query_id", pa.array(query))


def _table(answers: Given) -> pa.Table:
    columns: Any = answers
    if not isinstance(answers, Mapping):
        if hasattr(answers, "columns"):  # an Arrow table, or a data frame of pandas or polars
            return _arrow(answers)
        positions = np.asarray(_array(answers))
        if positions.ndim != 2 or positions.shape[1] != 2:
            raise CallError(
                "answers must be a table, columns by name, or positions (u, v)",
                found=f"an array of shape {positions.shape}",
                required="shape (number of queries, 2)",
            )
        columns = {"u": positions[:, 0], "v": positions[:, 1]}
    columns = {name: _array(column) for name, column in columns.items()}
    for name, column in columns.items():
        if np.iscomplexobj(column):
            raise CallError(
                "answers must be real numbers",
                where=str(name),
                found="complex numbers",
                fix="Give u and v as two real columns.",
            )
    return _arrow(columns)


def _array(values: Any) -> Any:
    """Return a torch tensor, on whatever device, as an array, and other values as they are."""
    if np.ma.is_masked(values):
        raise CallError(
            "answers must not be masked",
            found=plural(np.ma.count_masked(values), "masked value"),
            fix="Give columns with pair_id and query_id, without the rows that have no answer.",
        )
    return values.detach().cpu().numpy() if hasattr(values, "detach") else values


def _arrow(columns: Any) -> pa.Table:
    try:
        return pa.table(columns)
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise CallError("the answers are not columns of one length", found=str(error)) from error


def _sha256(table: pa.Table) -> str:
    """Return the sha256 of a table, written as an Arrow stream."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table.combine_chunks())
    return hashlib.sha256(sink.getvalue()).hexdigest()


def check(
    submission: Path | str,
    data: Dataset | Path | str,
    *,
    allow_missing: bool = False,
    limits: Limits | None = None,
) -> list[Issue]:
    """Return every problem of a submission; an empty list means that it can be scored.

    Reading, checking and placing rows is the same code that `evaluate` runs.

    Args:
        submission: The submission's file.
        data: The dataset, or its folder; its queries suffice.
        allow_missing: Whether a query without an answer is not a problem.
        limits: Read the file in a child process with these limits, as the commands do; None reads
            it in this process.

    Raises:
        SpecError: The dataset is at fault, not the submission.

    Examples:
        >>> path = pliant.predict("sample", "centroid").write("checked.parquet")
        >>> pliant.evaluator.check("checked.parquet", "sample")
        []
    """
    return inspect(submission, data, allow_missing=allow_missing, limits=limits).issues()


def inspect(
    submission: Path | str,
    data: Dataset | Path | str,
    *,
    allow_missing: bool = False,
    limits: Limits | None = None,
) -> Problems:
    """Return a submission's problems with their true totals, and hints; arguments as `check`.

    Examples:
        >>> path = pliant.predict("sample", "centroid").write("inspected.parquet")
        >>> problems = pliant.evaluator.inspect("inspected.parquet", "sample")
        >>> problems.total, problems.hints
        (0, [])
    """
    dataset = data if isinstance(data, Dataset) else Dataset.open(data)
    problems = Problems(submission)
    loaded = load(Path(submission), dataset, problems, allow_missing=allow_missing, limits=limits)
    if loaded is not None and isinstance(loaded.answers, PlacedAnswers):
        problems.hints = coordinate_hints(loaded.answers, loaded.queries)
    return problems
