"""Writes the truth of `datasets/full` with polars and DuckDB, and its rows as JSON for JavaScript.

    pip install polars==2.1.0 duckdb==2.0.0 pyarrow
    npm install hyparquet-writer@0.17.0
    python make_tables.py && node make_tables.mjs

Run it again only where that truth has changed: the suite is built from the files.
"""

from __future__ import annotations

import json
from pathlib import Path

import duckdb
import polars
import pyarrow.parquet as pq

HERE = Path(__file__).resolve().parent
TRUTH = HERE.parent / "datasets" / "full" / "truth" / "test.parquet"

if __name__ == "__main__":
    table = pq.read_table(TRUTH)
    footer = table.schema.metadata[b"pliant"].decode()
    plain = table.replace_schema_metadata(None)
    frame = polars.from_arrow(plain).with_columns(polars.col("tier").cast(polars.Categorical))
    frame.write_parquet(HERE / "polars.parquet", row_group_size=4, metadata={"pliant": footer})
    connection = duckdb.connect()
    connection.register("plain", plain)
    connection.execute(
        f"COPY (SELECT * FROM plain) TO '{HERE / 'duckdb.parquet'}' (FORMAT parquet, "
        "PARQUET_VERSION v2, COMPRESSION gzip, ROW_GROUP_SIZE_BYTES '1KB', ROW_GROUP_SIZE 4, "
        f"KV_METADATA {{pliant: $${footer}$$}})"
    )
    rows = {"pliant": footer, "rows": table.to_pylist()}
    (HERE / "truth.json").write_text(json.dumps(rows))
