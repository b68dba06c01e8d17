from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import pytest

from pliant.generator.config import GenerateConfig, split_counts
from pliant.generator.runner.engine import SequenceResult
from pliant.generator.runner.estimate import at_length, estimate_run
from pliant.generator.runner.plan import plan_run, plan_tasks
from pliant.generator.runner.progress import Forecast
from pliant.generator.seeding import SequenceTask
from tests.generator.runner.standin import InProcess, make, maker, small_config
from tests.known import known


def test_splits_never_shrink_as_a_set_grows() -> None:
    before = {"train": 0, "val": 0, "test": 0}
    for count in range(1, 60):
        now = {**dict.fromkeys(before, 0), **split_counts(count)}
        assert sum(now.values()) == count
        assert all(now[split] >= before[split] for split in before)
        before = now
    assert split_counts(10) == {"train": 7, "val": 1, "test": 2}


def test_a_larger_plan_holds_the_smaller_one() -> None:
    small = plan_tasks(GenerateConfig(tiers=("rope",), sequences=13))
    large = plan_tasks(GenerateConfig(tiers=("rope", "cloth-3"), sequences=57))
    assert set(small) < set(large)
    assert len({task.id for task in large}) == len(large) == 2 * 57


def result(seconds: float, size: int, *, warm: bool) -> SequenceResult:
    return SequenceResult("id", 10, size, seconds, seconds, warm=warm)


def test_a_forecast_by_hand() -> None:
    missing = [SequenceTask(tier, "test", k) for tier in ("rope", "cloth-1") for k in range(4)]
    forecast = Forecast.of(missing, frames=10, workers=2)
    for tier in ("rope", "cloth-1"):
        forecast.finish(tier, result(50.0, 4000, warm=False))  # loads code: only its size counts
    forecast.finish("rope", result(1.0, 1000, warm=True))
    assert forecast.left() is None  # nothing is known of the cloths
    forecast.finish("rope", result(3.0, 3000, warm=True))
    forecast.finish("cloth-1", result(70.0, 4000, warm=True))
    # 1 rope of 2 s and 8000 / 3 bytes, 2 cloths of 70 s and 4000 bytes, two at a time.
    assert forecast.left() == pytest.approx((71.0, 8000 / 3 + 8000))
    assert forecast.per_image() == {
        "rope": pytest.approx((0.2, 800 / 3)), "cloth-1": pytest.approx((7.0, 400)),
    }  # fmt: skip
    for tier in ("cloth-1", "cloth-1", "rope"):
        forecast.finish(tier, result(60.0, 4000, warm=True))
    assert forecast.left() == pytest.approx((0.0, 0.0))


def test_a_trial_counts_its_setup_once() -> None:
    trial = replace(result(4.0, 1000, warm=True), seconds=8.0, setup_cpu_s=2.0)
    longer = at_length(trial, 30)  # 4 s of setup and 4 s of 10 frames on the clock
    assert (longer.frames, longer.seconds, longer.bytes) == (30, 16.0, 3000)


@pytest.mark.long
def test_trials_and_runs_forecast_what_a_run_takes(tmp_path) -> None:
    changes: dict[str, Any] = {"frames": 8, "splits": {"train": 6}}
    config = small_config(**changes)
    plan = plan_run(config, tmp_path / "set")
    opened = maker(config, tmp_path / "trial", frame_s=0.05)
    started = time.monotonic()
    estimate = estimate_run(config, plan, 2, opened)
    trial_s = time.monotonic() - started  # contains the start of the workers
    forecasts = []

    def show(state) -> None:
        forecasts.append((state.frames, state.forecast.left()))

    out = tmp_path / "set"
    summary = make(out, workers=2, engine=InProcess(), progress=show, frame_s=0.05, **changes)
    sleeping_s = 6 * 8 * 0.05 / 2
    # Encoding and syncing come on top.
    assert sleeping_s <= estimate.seconds < 5 * sleeping_s + trial_s
    assert estimate.bytes == pytest.approx(summary.bytes, rel=0.05)
    assert forecasts[0] == (0, None)
    first = next(left for _, left in forecasts if left is not None)
    assert 0.8 * sleeping_s * 5 / 6 <= first.seconds < 5 * sleeping_s
    last = known(forecasts[-1][1])
    assert last.seconds == 0
