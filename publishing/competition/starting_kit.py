"""The starting kit: the queries, a template to fill in, and a program that fills it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from pliant.publishing.competition.archive import Members
from pliant.publishing.competition.facts import Competition
from pliant.publishing.competition.pages import file_bytes
from pliant.spec.io.parquet import read_table, write_table
from pliant.spec.storage import layout

EXAMPLE_PROGRAM: Final = "submit_without_pliant.py"


def kit_members(competition: Competition, public: Path, readme: str) -> Members:
    """Return the files of the starting kit by name.

    Args:
        competition: The competition.
        public: The public half.
        readme: Text of its README.md.
    """
    queries = layout.queries_path(public, competition.split)
    return {
        "README.md": readme.encode(),
        EXAMPLE_PROGRAM: file_bytes(f"examples/{EXAMPLE_PROGRAM}"),
        "template.parquet": _template(competition, queries),
        "data/dataset.json": public / layout.DATASET_JSON,
        f"data/queries/{competition.split}.parquet": queries,
    }


def _template(competition: Competition, queries: Path) -> bytes:
    """Return a submission whose every u and v is NaN, which no check passes."""
    keys = read_table(queries, "queries", ["pair_id", "query_id"])
    empty = pa.array(np.full(len(keys), np.nan, np.float32))
    footer = {
        "dataset": {key: competition.dataset[key] for key in ("id", "version")},
        "split": competition.split,
        "queries_sha256": competition.queries_sha256,
        "method": {"name": "template"},
    }
    table = keys.append_column("u", empty).append_column("v", empty)
    with tempfile.TemporaryDirectory(prefix="pliant-") as folder:
        path = Path(folder) / "template.parquet"
        write_table(path, table, "answers", footer)
        return path.read_bytes()
