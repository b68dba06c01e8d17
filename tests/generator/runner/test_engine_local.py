from __future__ import annotations

import os

import pytest

from pliant.generator.runner.engine_local import worker_cores


@pytest.fixture
def _six_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {1, 2, 3, 5, 8, 9}, raising=False)


@pytest.mark.usefixtures("_six_cores")
@pytest.mark.parametrize(
    ("workers", "shares"),
    [
        (1, [[1, 2, 3, 5, 8, 9]]),
        (2, [[1, 2, 3], [5, 8, 9]]),
        (4, [[1], [2, 3], [5], [8, 9]]),
        (6, [[1], [2], [3], [5], [8], [9]]),
        (7, [[1, 2, 3, 5, 8, 9]] * 7),
    ],
)
def test_workers_share_the_cores_evenly(workers: int, shares: list[list[int]]) -> None:
    assert [worker_cores(number, workers) for number in range(workers)] == shares
