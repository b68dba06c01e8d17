"""Runs: resumed like uninterrupted, watched honestly, answering from their folder."""

from __future__ import annotations

import html
import json
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from pliant.loaders.frame_store import FrameStore
from pliant.models import load_matcher
from pliant.models.timecycle import report
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.report import Guard
from pliant.models.timecycle.settings import TimeCycleSettings, TrackValidationSettings
from pliant.models.timecycle.trainer import train_timecycle
from pliant.models.timecycle.validation import (
    Stretch,
    curve,
    draw_stretches,
    errors_over_time,
    figures,
    track_centroid,
    track_identity,
)
from pliant.spec.configuration import read_settings, settings_to_dict
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, TrainingError
from tests.models.tiny_runs import assert_same_runs, last_checkpoint, timecycle, train_two_steps


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the pictures out where nobody looks at them."""
    monkeypatch.setattr(report, "write_timecycle_report", lambda *_: None)


@pytest.mark.long
@pytest.mark.usefixtures("no_report")
def test_resumed_equals_uninterrupted(tiny_episode: Path, tmp_path: Path) -> None:
    """Bit for bit: weights, running average, optimiser and history."""
    settings = timecycle("clips.choose=motion")
    dataset = Dataset.open(tiny_episode)
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    train_timecycle(dataset, whole, settings)
    train_two_steps(train_timecycle, dataset, parts, settings)
    assert last_checkpoint(parts).step == 2
    train_timecycle(dataset, parts, settings, resume=True)
    assert_same_runs(whole, parts, steps=6)


def test_a_run_is_a_folder_that_answers(tiny_episode: Path, tmp_path: Path) -> None:
    run, dataset = tmp_path / "run", Dataset.open(tiny_episode)
    facts = train_timecycle(dataset, run, timecycle())
    page = (run / "report.html").read_text()
    assert facts["guard"]["verdict"] in page
    assert "Does the cycle beat the trivial answers?" in page
    assert set(facts["guard"]["rmse_px_of_640"]) == {"trained", "identity", "centroid", "untrained"}
    assert json.loads((run / "run.json").read_text())["steps"] == 6
    stored = settings_to_dict(read_settings(TimeCycleSettings, run / "config.yaml"))
    assert stored == settings_to_dict(timecycle("tier=rope"))
    assert stored["kind"] == "timecycle"
    history = last_checkpoint(run).history
    for name in ("long", "skip", "similarity", "self"):
        assert all(np.isfinite(row[name]) for row in history if "loss" in row)
    matcher = load_matcher(run)
    assert isinstance(matcher, TimeCycleMatcher)
    described = matcher.describe()
    assert described["propagation"]["top_k"] == 10
    json.dumps(described)
    with pytest.raises(TrainingError, match="settings that it was started with"):
        train_timecycle(dataset, run, timecycle("seed=4"), resume=True)
    kept = (run / "config.yaml").read_text()
    (run / "config.yaml").write_text("pairs: {views: 4}\n" + kept)
    with pytest.raises(TrainingError, match=r"another method, or its config was edited.*pairs"):
        train_timecycle(dataset, run, timecycle(), resume=True)
    (run / "config.yaml").write_text("kind: timecycle\nnetwork: {descriptor_dim: 8}\n")
    with pytest.raises(TrainingError, match="do not fit"):
        load_matcher(run)


def test_the_shipped_recipe_can_be_read() -> None:
    recipe = files("pliant.models") / "configs" / "timecycle.yaml"
    settings = read_settings(TimeCycleSettings, Path(str(recipe)))
    assert (settings.patch_cells, settings.temperature) == (10, 32**-0.5)


def stretches(root: Path) -> list[Stretch]:
    store = FrameStore(Dataset.open(root), "rope", "test", (96, 64))
    settings = TrackValidationSettings(split="test", clips=2, frames=4, queries=10)
    return draw_stretches(store, settings, seed=0)


def test_errors_over_time_are_those_of_the_answers(tiny_episode: Path) -> None:
    """The truth has no error; the truth 3 px to the right is 3 px of 96 off, 20 of 640."""
    drawn = stretches(tiny_episode)
    assert all(stretch.truth()[1][0].all() for stretch in drawn)

    def shifted(by: float):
        def track(stretch: Stretch):
            yield from stretch.truth()[0][1:] + np.array([by, 0], dtype=np.float32)

        return track

    assert curve(errors_over_time(shifted(0), drawn)) == [0, 0, 0, 0]
    found = figures(errors_over_time(shifted(3), drawn))
    assert found == pytest.approx({"rmse_px_1": 20, "rmse_px": 20, "criterion_px": 20}, rel=1e-4)


def test_identity_and_centroid_are_what_they_say(tiny_episode: Path) -> None:
    drawn = stretches(tiny_episode)
    for stretch in drawn:
        start = stretch.truth()[0][0]
        assert all(np.array_equal(found, start) for found in track_identity(stretch))
        for found, number in zip(track_centroid(stretch), stretch.frames[1:], strict=True):
            mask = stretch.store.view(number).mask
            assert found[0, 0] == pytest.approx(np.nonzero(mask)[1].mean() + 0.5, rel=1e-5)
    # What hardly moves: staying is far better than the middle.
    still, middle = (curve(errors_over_time(t, drawn)) for t in (track_identity, track_centroid))
    assert all(a < b for a, b in zip(still, middle, strict=True))


def test_the_guard_says_what_is_not_beaten() -> None:
    """Worse than identity after one frame, better after five: the verdict names the one."""
    guard = Guard(
        {
            "trained": [2.0, 2, 2, 2, 2],
            "identity": [1.0, 2, 3, 4, 5],
            "centroid": [9.0] * 5,
            "untrained": [3.0] * 5,
        }
    )
    assert guard.verdict() == "The run does NOT beat identity after 1 frame."
    assert guard.beats("identity", 5)
    better = Guard({**guard.curves, "trained": [0.5] * 5})
    assert better.verdict().startswith("The run beats identity, centroid and an untrained")
    assert better.as_dict()["rmse_px_of_640"]["identity"] == {"1": 1.0, "5": 5}  # type: ignore[index]
    # Nobody fails where no point is seen, and the footer of a submission cannot store NaN.
    unseen = Guard({name: [*values[:4], np.nan] for name, values in better.curves.items()})
    assert unseen.listed == [1]
    assert unseen.verdict() == better.verdict()
    json.dumps(unseen.as_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("chosen", "says"),
    [(True, "for each network the read-out was chosen"), (False, "have the same propagation")],
)
def test_the_report_says_how_the_networks_were_read(
    tmp_path: Path, chosen: bool, says: str
) -> None:
    curves = {name: [1.0, 2.0] for name in ("trained", "identity", "centroid", "untrained")}
    history = [{"step": 10, "val/rmse_px_1": 1.0}]
    report.write_timecycle_report(tmp_path, history, Guard(curves), {}, chosen)
    page = html.unescape((tmp_path / "report.html").read_text())
    assert says in page
    assert '"title": "px of 640"' in page  # the curves of the validation, like the comparison


def test_validation_needs_long_enough_episodes(tiny_dataset: Path, tiny_episode: Path) -> None:
    settings = TrackValidationSettings(split="test", frames=24)
    store = FrameStore(Dataset.open(tiny_episode), "rope", "test", (96, 64))
    with pytest.raises(CallError, match="no episode of 25 frames"):
        draw_stretches(store, settings, seed=0)
    single = FrameStore(Dataset.open(tiny_dataset), "rope", "test", (96, 64))
    with pytest.raises(CallError, match=r"tier rope, split test: .*no episode of 2 frames"):
        draw_stretches(single, TrackValidationSettings(split="test", frames=1), seed=0)
