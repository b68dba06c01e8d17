"""The comparison of losses: the same for every arm, and the right trials go on."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.benchmarks.conftest import script


@pytest.fixture(scope="module")
def fair() -> Iterator[Any]:
    with script("fair_losses") as module:
        yield module


def test_arms_differ_in_nothing_but_their_loss_and_trials(fair: Any) -> None:
    study = fair.read_study(fair.CONFIG, quick=False)
    assert {len(arm.trials) for arm in study.arms.values()} == {6}
    assert all(set(arm.settings) == {"loss"} for arm in study.arms.values())
    for arm in study.arms.values():
        assert all(set(trial) == {"optimiser", "loss"} for trial in arm.trials)
    asked = {(stage.tier, arm) for stage in study.queue for arm in stage.arms}
    assert asked == {(tier, arm) for tier in study.tiers for arm in study.arms}
    assert {f"{tier}{end}" for tier in study.tiers for end in ("", "-test")} == set(study.sets)


def reached(fair: Any, out: Path, trial: int, seed: int, curve: dict[int, float]) -> None:
    """Write what a training of arm `distributional` leaves after its last validation."""
    training = fair.Training("cloth-1", "distributional", trial, seed, max(curve))
    folder = out / training.folder / "checkpoints" / f"{max(curve):07d}"
    folder.mkdir(parents=True)
    history = [{"step": step, fair.CHOICE: error} for step, error in curve.items()]
    (folder / "state.json").write_text(json.dumps({"history": history}))


def test_the_best_trials_go_on_and_the_last_one_is_repeated(fair: Any, tmp_path: Path) -> None:
    study = fair.read_study(fair.CONFIG, quick=False)
    first, second = (rung.steps for rung in study.rungs)

    def left() -> list[tuple[int, int, int]]:
        work = fair._open_trainings(study, tmp_path, "cloth-1", "distributional")
        return [(each.trial, each.seed, each.steps) for each in work]

    assert left() == [(trial, 0, first) for trial in range(6)]
    errors = (50.0, 40.0, 60.0, 30.0, 70.0, 80.0)
    for trial in (0, 2, 4, 5):
        reached(fair, tmp_path, trial, 0, {first: errors[trial]})
    assert left() == [(1, 0, first), (3, 0, first)]
    reached(fair, tmp_path, 1, 0, {first: errors[1], second: 20.0})
    reached(fair, tmp_path, 3, 0, {first: errors[3]})
    assert left() == [(3, 0, second)]
    reached(fair, tmp_path, 3, 0, {first: errors[3], second: 25.0})
    assert left() == [(1, seed, study.steps) for seed in range(3)]
    done = tmp_path / fair.Training("cloth-1", "distributional", 1, 2, study.steps).folder
    done.mkdir(parents=True)
    (done / "run.json").write_text('{"steps": 1}')
    assert left() == [(1, 0, study.steps), (1, 1, study.steps)]


def test_one_process_has_a_training_at_a_time(fair: Any, tmp_path: Path) -> None:
    with fair.claimed(tmp_path / "run") as mine:
        assert mine
        with fair.claimed(tmp_path / "run") as other:
            assert not other
    with fair.claimed(tmp_path / "run") as again:
        assert again
