"""Submissions of known answers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import write_table


@pytest.fixture(scope="session")
def submit(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path, float], Path]:
    """A function: dataset folder, shift in pixels -> a submission of the moved truth."""

    def write(root: Path, shift_px: float) -> Path:
        dataset = Dataset.open(root)
        queries, truth = dataset.queries("test"), dataset.truth("test")
        table = pa.table(
            {
                "pair_id": queries["pair_id"],
                "query_id": queries["query_id"],
                "u": pa.array(truth["u_b"].to_numpy() + np.float32(shift_px)),
                "v": truth["v_b"],
            }
        )
        footer = {
            "dataset": {"id": dataset.id, "version": dataset.version},
            "split": "test",
            "queries_sha256": dataset.queries_sha256("test"),
            "method": {"name": f"moved {shift_px:g} px"},
        }
        path = tmp_path_factory.mktemp("submission") / "answers.parquet"
        write_table(path, table, "answers", footer)
        return path

    return write
