"""Opens, checks and reads a submission, the same way for a check and for its scores.

Answers that are arrays in memory are checked like the rows of a file. `check` lists what is wrong
without scoring.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pliant.evaluator.arrays import RealArray
from pliant.evaluator.submission.answers import Answers, Scratch, read_answers
from pliant.evaluator.submission.hints import hints_without_truth
from pliant.evaluator.submission.matches import Matches, read_matches
from pliant.evaluator.submission.problems import Problems
from pliant.evaluator.submission.queries import Queries, read_queries
from pliant.evaluator.submission.submission_file import Submission, check_columns, open_submission
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, Issue

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
    answers: Answers | Matches


def load(
    path: Path, dataset: Dataset, problems: Problems, scratch: Scratch, *, allow_missing: bool
) -> Loaded | None:
    """Open, check and read a submission.

    Args:
        path: The file.
        dataset: The dataset it answers.
        problems: Receives everything that is wrong.
        scratch: Where long arrays live.
        allow_missing: Whether a query without an answer is not a problem.

    Returns:
        The submission, or None if there is a problem.

    Raises:
        SpecError: The dataset is at fault, not the submission.
    """
    submission = open_submission(path, dataset, problems)
    if submission is None:
        return None
    queries = read_queries(dataset, submission.split)
    answers: Answers | Matches
    if submission.kind == "matches":
        answers = read_matches(submission, queries, problems)
    else:
        answers = read_answers(submission, queries, problems, scratch, allow_missing=allow_missing)
    return None if problems else Loaded(submission, queries, answers)


def load_in_memory(
    answers: Given,
    dataset: Dataset,
    split: str,
    method: str,
    problems: Problems,
    scratch: Scratch,
    *,
    allow_missing: bool,
) -> Loaded | None:
    """Check and read answers that are arrays; arguments as `load` and `_open_answers`.

    Raises:
        CallError: The split has no queries, or the answers are not columns.
        SpecError: The dataset is at fault.
    """
    splits = dataset.splits_with_queries()
    if split not in splits:
        required = "one of " + ", ".join(splits)
        raise CallError("this split has no queries", found=repr(split), required=required)
    queries = read_queries(dataset, split)
    sha256 = dataset.queries_sha256(split)
    footer = {"split": split, "queries_sha256": sha256, "method": {"name": method}}
    submission = _open_answers(answers, queries, footer, problems)
    if submission is None:
        return None
    answers = read_answers(submission, queries, problems, scratch, allow_missing=allow_missing)
    return None if problems else Loaded(submission, queries, answers)


def _open_answers(
    answers: Given, queries: Queries, footer: Mapping[str, Any], problems: Problems
) -> Submission | None:
    """Return answers in memory as a submission.

    Args:
        answers: A table or a mapping with the columns of a submission, each one value per row, or
            the positions alone, float (R, 2), pixels. Without `pair_id` and `query_id` the rows
            are in the order of the queries.
        queries: The split's queries.
        footer: What the footer of a file says: `split`, `queries_sha256`, `method`.
        problems: Receives missing columns and columns of a wrong type.

    Raises:
        CallError: The answers are not a table, or rows without keys are not one per query.
    """
    table = _table(answers)
    if not {"pair_id", "query_id"} & set(table.column_names):
        if len(table) != queries.rows:
            raise CallError(
                "answers without pair_id and query_id must be one per query, in their order",
                found=f"{len(table):,} answers",
                required=f"{queries.rows:,}, the queries of split {queries.split}",
            )
        pair = np.repeat(np.arange(queries.pairs), np.diff(queries.starts))
        query = np.arange(queries.rows) - queries.starts[pair]
        table = table.append_column("pair_id", pa.array(pair))
        table = table.append_column("query_id", pa.array(query))
    columns = check_columns(table.schema, "answers", problems)
    if columns is None:
        return None
    used = table.select(list(columns))
    modes = pc.sum(pc.list_value_length(used["modes"])).as_py() if "modes" in columns else 0
    return Submission(
        name="answers in memory",
        schema=used.schema,
        read=lambda rows: iter(used.to_batches(rows)),
        sha256=lambda: _sha256(used),
        kind="answers",
        footer=footer,
        columns=columns,
        rows=len(used),
        most_modes=modes or 0,
    )


def _table(answers: Given) -> pa.Table:
    if isinstance(answers, pa.Table):
        return answers
    columns: Any = answers
    if not isinstance(answers, Mapping):
        positions = np.asarray(answers)
        if positions.ndim != 2 or positions.shape[1] != 2:
            raise CallError(
                "answers must be a table, columns by name, or positions (u, v)",
                found=f"an array of shape {positions.shape}",
                required="shape (number of queries, 2)",
            )
        columns = {"u": positions[:, 0], "v": positions[:, 1]}
    try:
        return pa.table(dict(columns))
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
    truth: Path | str | None = None,
    *,
    allow_missing: bool = False,
) -> list[Issue]:
    """Return every problem of a submission; an empty list means that it can be scored.

    Reading, checking and placing rows is the same code that `evaluate` runs.

    Args:
        submission: The submission's file.
        data: The dataset, or its folder; its queries suffice.
        truth: Not needed for a check; accepted so that calls look alike.
        allow_missing: Whether a query without an answer is not a problem.

    Raises:
        SpecError: The dataset is at fault, not the submission.
    """
    return inspect(submission, data, allow_missing=allow_missing).issues()


def inspect(
    submission: Path | str, data: Dataset | Path | str, *, allow_missing: bool = False
) -> Problems:
    """Return a submission's problems with their true totals, and hints; arguments as `check`."""
    dataset = data if isinstance(data, Dataset) else Dataset.open(data)
    problems = Problems(submission)
    path = Path(submission)
    loaded = load(path, dataset, problems, Scratch(), allow_missing=allow_missing)
    if loaded is not None and isinstance(loaded.answers, Answers):
        problems.hints = hints_without_truth(loaded.answers, loaded.queries)
    return problems
