"""`pliant train timecycle` and `pliant predict` with what it made."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

from pliant.baselines.predict import predict
from pliant.cli.main import run
from pliant.models import load_matcher
from pliant.models.timecycle.matcher import load_timecycle
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_footer, read_table
from tests.conftest import Called
from tests.models.tiny_runs import TIMECYCLE, options


@pytest.fixture(scope="module")
def trained(tiny_episode: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("timecycle") / "run"
    train = ["train", "timecycle", "--data", str(tiny_episode), "--out", str(out)]
    assert run([*train, *options(*TIMECYCLE, "steps=2")]) == 0
    return out


def test_train_predict_and_score(
    trained: Path, tiny_episode: Path, tmp_path: Path, called: Called
) -> None:
    """The whole way: a run's answers pass the check and are scored as tracks."""
    submission, report = tmp_path / "sub.parquet", tmp_path / "report"
    data = ("--data", tiny_episode)
    _, said, _ = called("predict", trained, *data, "--out", submission, "--json")
    assert json.loads(said)["method"]["name"] == "timecycle"
    assert called("check", submission, *data)[0] == 0
    method = read_footer(submission)["method"]
    assert method["propagation"]["context"] == 7
    assert method["mask"] == "given"
    assert called("evaluate", submission, *data, "--protocol", "track", "--out", report)[0] == 0
    scores = json.loads((report / "scores.json").read_text())
    assert scores["overall"]["rmse_px"] > 0
    assert scores["curves"]["overall"]["rmse_over_time"]["frames"]


def test_pairs_of_an_episode_are_tracked_through_the_frames_between(
    trained: Path, tiny_episode: Path, tmp_path: Path
) -> None:
    """What the submission says of a pair is what tracking from its source says.

    A copy, as workers get one, says the same.
    """
    dataset, matcher = Dataset.open(tiny_episode), load_timecycle(trained)
    path, again = tmp_path / "one.parquet", tmp_path / "two.parquet"
    predict(dataset, "test", matcher, path)
    predict(dataset, "test", pickle.loads(pickle.dumps(matcher)), again)
    assert path.read_bytes() == again.read_bytes()
    table = read_table(path, "answers")
    found = np.stack([table["u"].to_numpy(), table["v"].to_numpy()], axis=1)
    for pair in dataset.pairs("test"):
        sequence, a, b = pair.source.sequence.id, pair.source.index, pair.target.index
        step = 1 if b > a else -1
        frames = [dataset.frame(sequence, frame) for frame in range(a, b + step, step)]
        *_, last = matcher.track(frames, pair.uv_a_px)
        rows = table["pair_id"].to_numpy() == pair.pair_id
        np.testing.assert_allclose(found[rows], last.uv_px, atol=1e-3)


def test_other_pairs_are_answered_in_one_step(
    trained: Path, tiny_dataset: Path, tmp_path: Path
) -> None:
    """Configurations are no frames in time: nothing lies between them."""
    path = tmp_path / "sub.parquet"
    predict(Dataset.open(tiny_dataset), "test", load_matcher(trained), path)
    assert run(["check", str(path), "--data", str(tiny_dataset)]) == 0
