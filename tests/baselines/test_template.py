"""`pliant submission` without answers: refused with every row named, then filled and scored."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pliant.cli.main import run
from pliant.evaluator import check, evaluate, inspect
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


def test_filled_template_is_scored(tmp_path: Path) -> None:
    """Filled with the truth, and with the footer that pyarrow keeps, it scores 0."""
    out = tmp_path / "mine.parquet"
    assert written(out, "--method", "mine") == 0
    table = pq.read_table(out)
    truth = pq.read_table(DATA / "truth" / "test.parquet")
    for column, true in (("u", "u_b"), ("v", "v_b")):
        table = table.set_column(table.column_names.index(column), column, truth[true])
    pq.write_table(table, out)
    assert check(out, DATA) == []
    scores = evaluate(out, DATA)
    assert scores.overall["rmse_px"] == 0
    assert scores.method == "mine"


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


def test_split_without_queries_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert written(tmp_path / "mine.parquet", "--split", "train") == 2
    assert "no queries for split 'train'; required: test" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
