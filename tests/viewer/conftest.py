"""Submissions of known answers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pliant.baselines.submission_file import query_keys, write_answers
from pliant.spec.answers import Answers
from pliant.spec.dataset import Dataset


@pytest.fixture(scope="session")
def submit(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path, float], Path]:
    """A function: dataset folder, shift in pixels -> a submission of the moved truth."""

    def write(root: Path, shift_px: float) -> Path:
        dataset = Dataset.open(root)
        truth, keys = dataset.truth("test"), query_keys(dataset, "test")
        uv_px = np.stack([truth["u_b"], truth["v_b"]], axis=1) + np.array([shift_px, 0], np.float32)
        path = tmp_path_factory.mktemp("submission") / "answers.parquet"
        method = {"name": f"moved {shift_px:g} px"}
        write_answers(path, dataset, "test", keys, Answers(uv_px), method)
        return path

    return write
