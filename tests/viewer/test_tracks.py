"""Pictures of predicted tracks: from a submission whose answers are the truth, moved."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pliant.cli.main import run
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SubmissionError
from pliant.viewer.reading_tracks import predicted_tracks
from pliant.viewer.tracks import Tracks, draw_tracks

Submit = Callable[[Path, float], Path]


@pytest.fixture(scope="module")
def submission(tiny_episode: Path, submit: Submit) -> Path:
    """Every answer 5 px to the right of the truth."""
    return submit(tiny_episode, 5.0)


@pytest.fixture(scope="module")
def tracks(tiny_episode: Path, submission: Path) -> Tracks:
    return predicted_tracks(Dataset.open(tiny_episode), submission)


def test_tracks_are_the_answers_of_one_source_frame(tiny_episode: Path, tracks: Tracks) -> None:
    dataset = Dataset.open(tiny_episode)
    assert tracks.sequence.id == "rope-test-000000"
    assert tracks.titles[0] == "moved 5 px, rope-test-000000, frame 0"
    assert {title.split(", ")[3] for k, title in tracks.titles.items() if k} == {"RMSE 5.0 px"}
    queries = dataset.queries("test")
    from_0 = queries["frame_a"].to_numpy() == 0
    assert set(tracks.places) == {0, *queries["frame_b"].to_numpy()[from_0].tolist()}
    assert len(tracks.colours) == len(tracks.places[0]) <= 24
    assert tracks.truth is not None
    for frame, truth in tracks.truth.items():
        gap = tracks.places[frame] - truth
        seen = np.isfinite(gap).all(axis=1)
        assert seen.any()
        np.testing.assert_allclose(gap[seen], [[5, 0]] * int(seen.sum()), atol=1e-4)


def test_a_strip(tracks: Tracks, tmp_path: Path) -> None:
    asked = sorted(tracks.places)
    draw_tracks(tracks, [0, asked[1]], tmp_path / "a.png")
    draw_tracks(tracks, [0], tmp_path / "b.png")
    with Image.open(tmp_path / "a.png") as two, Image.open(tmp_path / "b.png") as one:
        assert two.size == (2 * one.size[0], one.size[1])


def test_the_command(
    tiny_episode: Path, submission: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    view = ["view", str(tiny_episode), "--tracks", str(submission), "--out"]
    assert run([*view, str(tmp_path / "t.png"), "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["figure"] == "tracks"
    assert run([*view, str(tmp_path / "t.png"), "--frames", "0"]) == 0
    assert run([*view, str(tmp_path / "t.png"), "--frames", "0,99"]) == 2
    assert "says nothing of this frame" in capfd.readouterr().err
    assert run([*view, str(tmp_path / "t.png"), "--frames", "first"]) == 2
    assert "frames are whole numbers" in capfd.readouterr().err
    assert run([*view, str(tmp_path / "t.bmp")]) == 2
    assert ".svg" in capfd.readouterr().err
    out = ["--out", str(tmp_path / "t.png")]
    assert run(["view", str(tiny_episode), "--frames", "0", *out]) == 2
    assert "--frames belongs to --tracks" in capfd.readouterr().err


def test_a_submission_for_something_else_is_refused(
    tiny_dataset: Path, tiny_episode: Path, submission: Path
) -> None:
    with pytest.raises(SubmissionError, match="pliant check"):
        predicted_tracks(Dataset.open(tiny_dataset), submission)
    with pytest.raises(CallError, match="no pair of the submission is in one episode"):
        predicted_tracks(Dataset.open(tiny_episode), submission, "rope-train-000000")
