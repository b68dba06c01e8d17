"""Writes submission files: columns, footer; an interrupted run leaves no partial file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.answers import Answers, Matches
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, PliantError
from pliant.spec.io.parquet import read_footer, write_table
from pliant.spec.io.writing import cannot_write, require_folder
from pliant.spec.tables import ANSWERS_OPTIONAL
from pliant.spec.text import name_fault

Kind = Literal["answers", "matches"]


@dataclass(frozen=True)
class Keys:
    """Which queries a submission's rows answer.

    Attributes:
        pair_id: int32 (N,).
        query_id: int32 (N,).
    """

    pair_id: npt.NDArray[np.int32]
    query_id: npt.NDArray[np.int32]


def query_keys(dataset: Dataset, split: str) -> Keys:
    """Return the keys of a split's queries, in the order of the file."""
    queries = dataset.queries(split)
    return Keys(queries.column("pair_id").to_numpy(), queries.column("query_id").to_numpy())


def submission_footer(dataset: Dataset, split: str, method: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a submission's footer says in addition to its spec version and table.

    Args:
        dataset: The dataset whose queries are answered.
        split: The split.
        method: JSON-able facts of the method, at least `name`.
    """
    return {
        "dataset": {"id": dataset.id, "version": dataset.version},
        "split": split,
        "queries_sha256": dataset.queries_sha256(split),
        "method": dict(method),
    }


def write_answers(
    path: Path | str,
    dataset: Dataset,
    split: str,
    keys: Keys,
    answers: Answers,
    method: Mapping[str, Any],
) -> None:
    """Write a submission of kind `answers`.

    Args:
        path: Where to; an earlier submission there is replaced.
        dataset: The dataset whose queries are answered.
        split: The split.
        keys: Which queries, N of them.
        answers: Their answers, in the same order.
        method: JSON-able facts of the method, at least `name`.

    Raises:
        CallError: The file cannot be written there.
    """
    table = answers_table(keys, answers)
    _write(path, table, "answers", submission_footer(dataset, split, method))


def answers_table(keys: Keys, answers: Answers) -> pa.Table:
    """Return answers as the table of a submission.

    Args:
        keys: Which queries, N of them.
        answers: Their answers, in the same order.
    """
    columns: dict[str, Any] = {
        "pair_id": pa.array(keys.pair_id, pa.int32()),
        "query_id": pa.array(keys.query_id, pa.int32()),
        "u": pa.array(answers.uv_px[:, 0].astype(np.float32)),
        "v": pa.array(answers.uv_px[:, 1].astype(np.float32)),
    }
    if answers.visible is not None:
        columns["visible"] = pa.array(answers.visible.astype(np.float32))
    if answers.sigma_px is not None:
        columns["sigma"] = pa.array(answers.sigma_px.astype(np.float32))
    if answers.modes is not None:
        columns["modes"] = _modes_column(answers.modes)
    return pa.table(columns)


def write_matches(
    path: Path | str,
    dataset: Dataset,
    split: str,
    matches: Sequence[tuple[int, Matches]],
    method: Mapping[str, Any],
) -> None:
    """Write a submission of kind `matches`.

    Args:
        path: Where to; an earlier submission there is replaced.
        dataset: The dataset whose pairs were matched.
        split: The split.
        matches: (pair_id, matches) of each pair, ascending.
        method: JSON-able facts of the method, at least `name`.

    Raises:
        CallError: The file cannot be written there.
    """
    counts = [len(found.score) for _, found in matches]
    pair_id = np.repeat(np.array([pair for pair, _ in matches], dtype=np.int32), counts)
    nothing = np.zeros((0, 2), dtype=np.float32)
    uv_a_px = np.concatenate([nothing, *(found.uv_a_px for _, found in matches)])
    uv_b_px = np.concatenate([nothing, *(found.uv_b_px for _, found in matches)])
    score = np.concatenate([nothing[:, 0], *(found.score for _, found in matches)])
    columns = {
        "pair_id": pa.array(pair_id, pa.int32()),
        "u_a": pa.array(uv_a_px[:, 0]),
        "v_a": pa.array(uv_a_px[:, 1]),
        "u": pa.array(uv_b_px[:, 0]),
        "v": pa.array(uv_b_px[:, 1]),
        "score": pa.array(score),
    }
    _write(path, pa.table(columns), "matches", submission_footer(dataset, split, method))


def write_template(
    dataset: Dataset,
    split: str,
    out: Path | str,
    kind: Kind = "answers",
    *,
    name: str = "template",
) -> int:
    """Write a submission that lacks nothing but its answers.

    Keys and footer are right; every position is NaN, which no check passes, so that a row
    forgotten is a row reported. Of kind `matches` there is one row per pair, to be replaced by
    as many as the method finds.

    Args:
        dataset: The dataset.
        split: One of its splits with queries.
        out: Where to; an earlier submission there is replaced.
        kind: `answers` or `matches`.
        name: The method's name in the footer; reports show it.

    Returns:
        The rows written.

    Raises:
        CallError: The split has no queries, or the file cannot be written there.
    """
    check_split(dataset, split)
    check_method_name(name)
    keys = query_keys(dataset, split)
    if kind == "answers":
        empty = np.full((len(keys.pair_id), 2), np.nan, dtype=np.float32)
        write_answers(out, dataset, split, keys, Answers(uv_px=empty), {"name": name})
        return len(keys.pair_id)
    pairs = np.unique(keys.pair_id)
    nowhere = np.full((1, 2), np.nan, dtype=np.float32)
    row = Matches(nowhere, nowhere, nowhere[:, 0])
    write_matches(out, dataset, split, [(int(pair), row) for pair in pairs], {"name": name})
    return len(pairs)


def check_split(dataset: Dataset, split: str) -> None:
    """Refuse a split that asks nothing.

    Args:
        dataset: The dataset.
        split: The split.

    Raises:
        CallError: The dataset has no queries for it.
    """
    asked = dataset.splits_with_queries()
    if split not in asked:
        raise CallError(
            f"the dataset has no queries for split {split!r}",
            path=dataset.root,
            required=" or ".join(asked) or "a dataset with queries",
            fix=None
            if asked
            else "Queries need two frames of one tier in val or test: generate more sequences",
        )


def check_method_name(name: object) -> None:
    """Refuse a name of a method that cannot be displayed in a report.

    Raises:
        CallError: It is not a text, blank, or has control or zero-width characters.
    """
    fault = name_fault(name) if isinstance(name, str) else type(name).__name__
    if fault is not None:
        raise CallError(
            "the method's name cannot be shown",
            where="name",
            found=fault,
            required="a text without control or zero-width characters, such as my-matcher",
        )


def check_writable(path: Path | str) -> None:
    """Refuse an output file that could not be written, before the work is done.

    Args:
        path: The submission to be written.

    Raises:
        CallError: Its folder is missing or cannot be written to, or the path exists and is
            not a submission.
    """
    path = Path(path)
    require_folder(path.parent)
    try:
        exists = path.exists()
    except OSError as error:  # the name is too long, or a folder above cannot be searched
        raise cannot_write(path, error) from error
    if exists and not _is_submission(path):
        raise CallError(
            "the file exists, is not a submission, and is not replaced",
            path=path,
            fix="Choose another file",
        )


def _is_submission(path: Path) -> bool:
    if not path.is_file():
        return False
    try:
        return read_footer(path).get("table") in ("answers", "matches")
    except PliantError:
        return False


def _modes_column(modes: Sequence[npt.NDArray[np.float32]]) -> Any:
    rows = [row.reshape(-1, 4).astype(np.float32) for row in modes]
    offsets = np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int32)
    flat = np.concatenate([np.zeros((0, 4), dtype=np.float32), *rows])  # (sum of M_i, 4)
    kind = ANSWERS_OPTIONAL.field("modes").type
    fields = [kind.value_type.field(index) for index in range(4)]
    values = pa.StructArray.from_arrays([pa.array(column) for column in flat.T], fields=fields)
    return pa.ListArray.from_arrays(pa.array(offsets), values, type=kind)


def _write(path: Path | str, table: pa.Table, name: Kind, footer: Mapping[str, Any]) -> None:
    path = Path(path)
    check_writable(path)
    write_table(path, table, name, footer)
