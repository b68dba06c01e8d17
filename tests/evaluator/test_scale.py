"""The score does not depend on how the rows are cut, ordered or stored."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np

from pliant.evaluator import evaluate
from pliant.evaluator.statistics.bootstrap import Bootstrap, intervals
from pliant.evaluator.statistics.crossing import Crossing
from pliant.evaluator.statistics.ratios import Ratio


def test_memory_does_not_grow_with_row_groups(scene_maker: Any, tmp_path: Path) -> None:
    """Python's own allocations for 20,000 rows stay near what the stored arrays take."""
    scene = scene_maker(
        tmp_path / "data", sequences=50, frames=3, queries=100, images=False, tiers=("cloth",)
    )
    path = scene.submit(tmp_path / "s.parquet")
    evaluate(path, scene.root, protocol="paper")
    tracemalloc.start()
    evaluate(path, scene.root, protocol="paper")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6


def test_intervals_cover_what_they_should() -> None:
    """Of 400 made-up datasets with a known mean, about 95 % of the intervals hold it."""
    ratio = Ratio("mean", "lower", "", "", "", "total", "count")
    settings = Bootstrap(unit="sequences", replicates=400, seed=0, level=0.95)
    rng = np.random.default_rng(0)
    sequences, pairs = 8, 5
    hits = 0
    for _ in range(400):
        per_sequence = rng.normal(10, 3, sequences)
        values = np.repeat(per_sequence, pairs) + rng.normal(0, 1, sequences * pairs)
        codes = np.repeat(np.arange(sequences), pairs)
        crossing = Crossing.of(codes, codes, np.zeros(len(codes), int), 1)
        columns = {"total": values, "count": np.ones(len(values))}
        low, high = intervals([ratio], columns, crossing, settings)[0]["mean"]
        hits += low <= 10 <= high
    assert 0.92 <= hits / 400 <= 0.98
