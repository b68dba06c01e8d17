"""Submissions to the dataset `full`, as `submissions.yaml` lists them: valid and broken ones."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.conventions import FOOTER_KEY, SPEC_VERSION
from pliant.spec.io.parquet import read_table
from pliant.spec.io.reading import sha256_file
from pliant.spec.io.yamlfiles import read_yaml
from pliant.spec.storage.layout import queries_name
from pliant.spec.tables import ANSWERS_OPTIONAL
from tests.conformance.edits import change_document

SPLIT: Final = "test"
CASES: Final[list[dict[str, Any]]] = read_yaml(Path(__file__).with_name("submissions.yaml"))
"""Each with its name, what it `is`, its codes, and what `write_submission` changes."""

Columns = dict[str, Any]

_ROW: Final = 3
"""The row that a case changes."""

_MODE: Final = ("u", "v", "sigma", "weight")


def perfect(dataset: Path, table: str) -> tuple[Columns, dict[str, Any]]:
    """Return the columns and the footer of a submission that gives the truth.

    Args:
        dataset: The dataset `full`.
        table: `answers` or `matches`.
    """
    truth = read_table(dataset / "truth" / f"{SPLIT}.parquet", "truth")
    queries = read_table(dataset / queries_name(SPLIT), "queries")
    given = {"pair_id": truth["pair_id"], "u": truth["u_b"], "v": truth["v_b"]}
    if table == "answers":
        given["query_id"] = truth["query_id"]
    else:
        given |= {"u_a": queries["u_a"], "v_a": queries["v_a"]}
        given["score"] = pa.chunked_array([np.ones(len(queries), np.float32)])
    footer = {
        "spec_version": SPEC_VERSION,
        "table": table,
        "dataset": {"id": "conformance-full", "version": "1.0.0"},
        "split": SPLIT,
        "queries_sha256": sha256_file(dataset / queries_name(SPLIT)),
        "method": {"name": "truth"},
    }
    return {name: column.to_numpy().copy() for name, column in given.items()}, footer


def write_submission(case: Mapping[str, Any], dataset: Path, path: Path) -> None:
    """Write the file of a case.

    Args:
        case: Of `CASES`. `fill` adds columns of one value, `set` changes one row, `rows` takes
            rows, `drop` and `cast` change columns, `modes` gives one row these (u, v, sigma,
            weight) and the others good ones, `footer` changes the footer or leaves it out, `file`
            replaces the bytes.
        dataset: The dataset `full`.
        path: Where to.
    """
    columns, footer = perfect(dataset, case.get("table", "answers"))
    count = len(columns["pair_id"])
    for name, value in case.get("fill", {}).items():
        columns[name] = np.full(count, value, np.float32 if isinstance(value, float) else object)
    for name, value in case.get("set", {}).items():
        if value is None:
            values = columns[name].tolist()
            columns[name] = pa.array([*values[:_ROW], None, *values[_ROW + 1 :]], pa.float32())
        else:
            columns[name][_ROW] = float(value)
    for name, kind in case.get("cast", {}).items():
        text = [str(value) for value in columns[name]]
        columns[name] = text if kind == "text" else columns[name].astype(kind)
    if "rows" in case:
        index = _chosen(case["rows"], count)
        columns = {name: column[index] for name, column in columns.items()}
    if "modes" in case:
        modes = [[dict(zip(_MODE, (1.0, 2.0, 3.0, 1.0), strict=True))]] * count
        modes[_ROW] = [dict(zip(_MODE, mode, strict=True)) for mode in case["modes"]]
        columns["modes"] = pa.array(modes, ANSWERS_OPTIONAL.field("modes").type)
    columns.pop(case.get("drop", ""), None)
    change_document(footer, **(case.get("footer", {}) or {}))
    left_out = case.get("footer", {}) is None
    metadata = {} if left_out else {FOOTER_KEY: json.dumps(footer).encode()}
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(columns).replace_schema_metadata(metadata), sink)
    data = sink.getvalue().to_pybytes()
    csv = b"pair_id,query_id,u,v\n0,0,1.5,2.5\n"
    files = {"csv": csv, "empty": b"", "half": data[: len(data) // 2]}
    path.write_bytes(files.get(case.get("file", ""), data))


def _chosen(rows: str, count: int) -> Any:
    return {
        "shuffled": np.random.default_rng(0).permutation(count),
        "first two": np.arange(2),
        "all but the last": np.arange(count - 1),
        "none": np.arange(0),
        "the fourth twice": np.array([*range(count), 3]),
    }[rows]
