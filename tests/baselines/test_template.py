"""`pliant submission` without answers: refused with every row named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pliant.cli.main import run
from pliant.evaluator import check, inspect
from pliant.spec.io.parquet import read_footer

DATA = Path(__file__).resolve().parents[1] / "data" / "tiny-submission" / "dataset"


def written(out: Path, *options: str) -> int:
    return run(["submission", "--data", str(DATA), "--out", str(out), *options])


def test_unfilled_template_names_every_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine.parquet"
    assert written(out) == 0
    queries = pq.read_table(DATA / "queries" / "test.parquet")
    said = capsys.readouterr().out
    assert f"{len(queries):,} answers of" in said
    assert f"pliant check {out} --data {DATA}" in said
    problems = inspect(out, DATA)
    assert problems.counts == {"VALUE_NOT_FINITE": 2 * len(queries)}  # u and v of every row
    first = problems.issues()[0]
    assert "row 0 (pair 0, query 0)" in first.where
    assert "nan" in first.message
    assert "finite position" in first.message
    assert run(["check", str(out), "--data", str(DATA)]) == 1


def test_template_of_matches_has_a_row_a_pair(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "matches.parquet"
    assert written(out, "--kind", "matches", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    pairs = np.unique(pq.read_table(DATA / "queries" / "test.parquet")["pair_id"])
    assert document["rows"] == len(pairs) == len(pq.read_table(out))
    assert read_footer(out)["table"] == "matches"
    assert {issue.code for issue in check(out, DATA)} == {"VALUE_NOT_FINITE"}
