from __future__ import annotations

import multiprocessing
import os
import threading
from pathlib import Path

import pytest

from pliant.generator.runner.engine import Failed, Finished, Rendered
from pliant.generator.runner.engine_local import LocalEngine, worker_cores
from pliant.generator.seeding import SequenceTask
from tests.generator.runner.standin import maker, small_config


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


@pytest.mark.parametrize(
    ("fault", "stall_s", "error"),
    [("hang", 2.0, "the worker process hung: it was killed"), ("memory", 600.0, "MemoryError")],
)
def test_a_worker_that_hangs_or_has_no_memory_fails_its_sequence(
    fault: str, stall_s: float, error: str, tmp_path: Path
) -> None:
    config = small_config()
    task = SequenceTask("rope", "train", 0)
    engine = LocalEngine(1, stall_s=stall_s)
    opened = maker(config, tmp_path, {task.id: fault})
    events = [each for each in engine.events([task], opened) if isinstance(each, Failed)]
    assert [error in each.error for each in events] == [True]
    assert not task.folder(tmp_path).exists()


def test_the_end_of_a_worker_without_a_task_does_not_end_the_run(tmp_path: Path) -> None:
    first, last = (SequenceTask("rope", "train", index) for index in range(2))
    opened = maker(small_config(), tmp_path, {last.id: "hang"})
    ended: list[Finished | Failed] = []
    for event in LocalEngine(2).events([first, last], opened):
        if isinstance(event, Rendered):
            continue
        ended.append(event)
        if isinstance(event, Finished):  # and no task is left for its worker
            workers = {each.name: each for each in multiprocessing.active_children()}
            workers["pliant-worker-0"].kill()
            threading.Timer(1.0, workers["pliant-worker-1"].kill).start()
    assert [(type(each), each.task) for each in ended] == [(Finished, first), (Failed, last)]
