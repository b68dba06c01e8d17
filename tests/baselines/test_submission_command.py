"""`pliant submission`: templates, and submissions made of tables; wrong ones name every row."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.evaluator import check, evaluate, inspect
from pliant.spec.io.parquet import read_footer
from tests.conftest import Called

DATA = Path(__file__).resolve().parents[1] / "data" / "tiny-submission" / "dataset"
Rows = list[dict[str, Any]]


@pytest.fixture(scope="module")
def rows() -> Rows:
    """The truth of every query."""
    truth = pq.read_table(DATA / "truth" / "test.parquet")
    columns = {"pair_id": "pair_id", "query_id": "query_id", "u": "u_b", "v": "v_b"}
    return [
        {name: row[column] for name, column in columns.items()}
        for row in truth.select([*columns.values()]).to_pylist()
    ]


def separated(separator: str, end: str = "\n") -> Callable[[Rows], bytes]:
    def text(rows: Rows) -> bytes:
        lines = [rows[0], *(row.values() for row in rows)]
        return end.join(separator.join(map(str, line)) for line in lines).encode()

    return text


def pandas_parquet(rows: Rows) -> bytes:
    """What `DataFrame.to_parquet` writes: its own metadata, float ids, the index as a column."""
    table = pa.Table.from_pylist(
        [{**row, "pair_id": float(row["pair_id"]), "__index_level_0__": 0} for row in rows]
    ).replace_schema_metadata({"pandas": "{}"})
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink)
    return sink.getvalue().to_pybytes()


FORMATS: dict[str, tuple[str, Callable[[Rows], bytes]]] = {
    "csv": ("mine.csv", separated(",")),
    "csv of Windows": ("mine.CSV", lambda rows: b"\xef\xbb\xbf" + separated(",", "\r\n")(rows)),
    "csv with semicolons": ("mine.csv", separated(";")),
    "tsv": ("mine.tsv", separated("\t")),
    "JSON lines": ("mine.jsonl", lambda rows: "\n".join(map(json.dumps, rows)).encode()),
    "JSON lines of Windows": (
        "mine.jsonl",
        lambda rows: b"\xef\xbb\xbf" + "\r\n".join([*map(json.dumps, rows), "", ""]).encode(),
    ),
    "pandas": ("mine.parquet", pandas_parquet),
}


Made = Callable[..., tuple[int, str, str]]


@pytest.fixture
def made(called: Called, tmp_path: Path) -> Made:
    """Make `out.parquet` of a file's content; a template without one."""

    def call(name: str = "", content: bytes | None = None, *options: str) -> tuple[int, str, str]:
        if content is not None:
            (tmp_path / name).write_bytes(content)
        file = [tmp_path / name] if name else []
        out = tmp_path / "out.parquet"
        return called("submission", *file, "--data", DATA, "--out", out, *options)

    return call


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("shuffled", [False, True])
def test_truth_in_any_format_scores_zero(
    kind: str, shuffled: bool, rows: Rows, tmp_path: Path, made: Made
) -> None:
    name, written = FORMATS[kind]
    order = np.random.default_rng(0).permutation(len(rows)) if shuffled else range(len(rows))
    code, said, _ = made(name, written([rows[row] for row in order]))
    assert code == 0
    assert ("left out: __index_level_0__" in said) == (kind == "pandas")
    assert check(tmp_path / "out.parquet", DATA) == []
    assert evaluate(tmp_path / "out.parquet", DATA).overall["rmse_px"] == 0
    assert read_footer(tmp_path / "out.parquet")["method"] == {"name": "mine"}


@pytest.mark.parametrize("suffix", ["csv", "jsonl"])
def test_visible_may_be_true_and_false_as_pandas_and_json_write_it(
    suffix: str, rows: Rows, tmp_path: Path, made: Made
) -> None:
    written = separated(",") if suffix == "csv" else FORMATS["JSON lines"][1]
    seen = [{**row, "visible": row["query_id"] % 2 == 0} for row in rows]
    assert made(f"mine.{suffix}", written(seen))[0] == 0
    table = pq.read_table(tmp_path / "out.parquet")
    assert table["visible"].to_pylist() == [float(row["visible"]) for row in seen]


@pytest.mark.parametrize("kind", [pa.int64(), pa.uint8(), pa.float16()])
def test_positions_that_lose_half_a_pixel_are_refused_as_by_check(
    kind: pa.DataType, rows: Rows, tmp_path: Path, made: Made
) -> None:
    column = pa.array([np.float16(row["v"]) for row in rows]).cast(kind, safe=False)
    table = pa.Table.from_pylist(rows)
    pq.write_table(table.set_column(3, "v", column), tmp_path / "mine.parquet")
    code, _, error = made("mine.parquet")
    assert code == 1
    assert f"column v: positions of this type lose up to half a pixel; found {kind}; " in error
    assert "required: float32 or float64. The centre of the first pixel" in error


def test_the_index_that_pandas_writes_is_left_out(rows: Rows, made: Made) -> None:
    indexed = [{"": number, **row} for number, row in enumerate(rows)]
    code, said, _ = made("mine.csv", separated(",")(indexed))
    assert code == 0
    assert "Columns left out: (unnamed). " in said


def test_rows_without_ids_are_in_the_order_of_the_queries(
    rows: Rows, tmp_path: Path, made: Made
) -> None:
    bare = [{"u": row["u"], "v": row["v"], "visible": 1, "sigma": 2.5} for row in rows]
    assert made("mine.csv", separated(",")(bare), "--method", "ours")[0] == 0
    scores = evaluate(tmp_path / "out.parquet", DATA)
    assert (scores.overall["rmse_px"], scores.method) == (0, "ours")
    assert pq.read_table(tmp_path / "out.parquet").column_names == [
        "pair_id", "query_id", "u", "v", "visible", "sigma"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("u,v\n1,2\n", 1, "one row per query; found 1 rows; required: {n}, in the order"),
        ("pair_id,query_id,u,v\n0,0,1,2\n", 1, "no answer; found 1 of {n}, none for pair_id"),
        ("pair_id,query_id,u,v\n0,0,1,2\n0,0,1,2\n", 1, "line 3: this query is answered again"),
        ("pair_id,query_id,u,v\n0,0,1,2\n77,1,1,2\n", 1, "line 3: there is no such query; found"),
        ("pair_id,query_id,u,v\n0,0.5,1,2\n", 1, "line 2, column query_id: .* '0.5'; .*whole"),
        ("u,v\n1,2\n1,\n", 1, "line 3, column v: a value is missing.*found ''"),
        ("u,v\n1,2\nnan,2\n", 1, "line 3, column u: .*found 'nan'"),
        ("u,v\n1,2\n2,3\n1,1e99\n", 1, "line 4, column v: .*found '1e99'"),  # of float32
        ("u,v\n\n1,2\n\n1,x\n", 1, "line 5, column v: .*found 'x'"),  # empty lines are not rows
        ("u,v,visible\n1,2,1\n1,2,1.2\n", 1, "line 3, column visible: .*'1.2'; .*0 to 1"),
        ("u,v,visible\n1,2,yes\n", 1, "line 2, column visible: .*'yes'; .*True or False"),
        ("u,v,sigma\n1,2,0\n", 1, "line 2, column sigma: .*'0'; required: .* greater than 0"),
        ("u,v\n1,True\n", 1, "line 2, column v: .*'True'; required: a finite number"),
        ("u,v\n1,1e30\n", 1, "line 2, column v: .*found '1e30'; required: .* within ±1e6"),
        ('u,v\n1,"2,5"\n', 1, "line 2, column v: .*found '2,5'; required: .* such as 320.5"),
        (f"u,v\n1,{'7' * 200_000}x\n", 1, r"line 2, column v: .*… \(200003 characters\)"),
        ("u,v\n1,2,3\n", 2, "cannot be read; found .*Expected 2 columns, got 3"),
        ("x,y\n1,2\n", 2, "columns are not those of a submission; found x, y; required: u, v"),
        ("pair_id,u,v\n1,2,3\n", 2, "found pair_id, u, v; .*both or neither of pair_id and quer"),
        ("u,u,v\n1,2,3\n", 2, "columns are not those of a submission; found u, u, v"),
        ("", 2, "cannot be read; found Empty CSV file; required: UTF-8 text with a header"),
        ("\udcff\n", 2, "cannot be read"),
    ],
)  # fmt: skip
def test_a_wrong_table_names_row_and_column(
    text: str, code: int, message: str, rows: Rows, tmp_path: Path, made: Made
) -> None:
    found, _, error = made("mine.csv", text.encode(errors="surrogateescape"))
    assert found == code
    assert re.search(message.replace("{n}", str(len(rows))), error), error
    assert len(error) < 1000
    assert not (tmp_path / "out.parquet").exists()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.jsonl", b'{"u": 1, "v": 2}\n[1, 2]\n', r"line 2: this is not JSON lines; found \[1"),
        ("a.jsonl", b'{"u": 1, "v": "x"}\n', "line 1, column v: .*found 'x'"),
        ("a.jsonl", b'\n \t\n{"u": 1, "v": "x"}\n', "line 3, column v: .*found 'x'"),
        ("a.jsonl", b'{"u": 1, "v": null}\n', "line 1, column v: .*found None"),
        (
            "a.jsonl",
            b'{"u": 1, "v": 2}\n{"u": 1, "v": 2, "visible": 0}\n',
            "line 1, column visible: .*found None",
        ),
        ("a.csv", b"u,v\n1.5,2.5\n1_0,2.5\n", "line 3, column u: .*found '1_0'"),
        ("a.jsonl", b"[" * 100_000, "line 1: this is not JSON lines"),
        ("a.parquet", b"PAR1", "cannot be read"),
        ("a.xlsx", b"PK", "found .xlsx; required: a .csv, .tsv, .jsonl or .parquet file"),
        ("a.npy", None, "file not found"),
    ],
)
def test_other_files(name: str, content: bytes | None, message: str, made: Made) -> None:
    code, _, error = made(name, content)
    assert code in (1, 2)
    assert re.search(message, error), error
    assert "Traceback" not in error


def test_some_answers_are_enough_where_that_is_said(rows: Rows, tmp_path: Path, made: Made) -> None:
    assert made("mine.csv", separated(",")(rows[3:7][::-1]), "--allow-missing")[0] == 0
    table = pq.read_table(tmp_path / "out.parquet")
    assert table["query_id"].to_pylist() == [row["query_id"] for row in rows[3:7]]


def test_matches(tmp_path: Path, made: Made) -> None:
    header = b"score\tpair_id\tu_a\tv_a\tu\tv\n"
    two = header + b"0.5\t1\t2.5\t3.5\t4\t5\n0.25\t0\t1\t1\t2\t2\n"
    assert made("mine.tsv", two, "--kind", "matches")[0] == 0
    table = pq.read_table(tmp_path / "out.parquet")
    assert table["pair_id"].to_pylist() == [0, 1]
    assert table["score"].to_pylist() == [0.25, 0.5]
    assert check(tmp_path / "out.parquet", DATA) == []
    unknown = header + b"0.5\t9999\t2.5\t3.5\t4\t5\n"
    code, _, error = made("mine.tsv", unknown, "--kind", "matches")
    assert code == 1
    assert "line 2: there is no such pair; found pair_id 9999" in error


def test_a_file_that_is_no_submission_is_kept(rows: Rows, tmp_path: Path, made: Made) -> None:
    (tmp_path / "out.parquet").write_text("precious")
    assert made("mine.csv", separated(",")(rows))[0] == 2
    assert (tmp_path / "out.parquet").read_text() == "precious"


def test_unfilled_template_names_every_row(tmp_path: Path, made: Made, called: Called) -> None:
    out = tmp_path / "out.parquet"
    code, said, _ = made()
    assert code == 0
    queries = pq.read_table(DATA / "queries" / "test.parquet")
    assert f"{len(queries):,} answers of" in said
    assert f"pliant check {out} --data {DATA}" in said
    problems = inspect(out, DATA)
    assert problems.counts == {"VALUE_NOT_FINITE": 2 * len(queries)}  # u and v of every row
    first = problems.issues()[0]
    assert "row 0 (pair 0, query 0)" in first.where
    assert "nan" in first.message
    assert "finite position" in first.message
    assert called("check", out, "--data", DATA)[0] == 1


def test_a_dataset_without_queries_says_what_they_need(tmp_path: Path, called: Called) -> None:
    data = shutil.copytree(DATA, tmp_path / "data")
    shutil.rmtree(data / "queries")
    code, _, error = called("submission", "--data", data, "--out", tmp_path / "out.parquet")
    assert code == 2
    assert (
        "no queries for split 'test'; required: a dataset with queries. Queries need two" in error
    )


def test_template_of_matches_has_a_row_a_pair(tmp_path: Path, made: Made) -> None:
    out = tmp_path / "out.parquet"
    code, said, _ = made("", None, "--kind", "matches", "--json")
    assert code == 0
    document = json.loads(said)
    pairs = np.unique(pq.read_table(DATA / "queries" / "test.parquet")["pair_id"])
    assert document["rows"] == len(pairs) == len(pq.read_table(out))
    assert read_footer(out)["table"] == "matches"
    assert {issue.code for issue in check(out, DATA)} == {"VALUE_NOT_FINITE"}
