from __future__ import annotations

from pathlib import Path

import pytest

from pliant.spec.dataset import Dataset
from tests.conftest import Called
from tests.models.tiny_runs import DON, options


@pytest.mark.parametrize("method", ["don", "timecycle"])
def test_resume_where_there_is_no_run_asks_for_no_setting(
    tiny_dataset: Path, tmp_path: Path, called: Called, method: str
) -> None:
    train = ("train", method, "--data", tiny_dataset, "--out", tmp_path / "nothing")
    code, _, error = called(*train, "--resume")
    assert code == 1
    assert "no checkpoint to resume" in error


@pytest.mark.parametrize(
    ("place", "fix"),
    [
        ("pliant.models.training.loop._step", "Interrupted: continue with --resume --out '{run}'"),
        ("pliant.models.don.trainer.draw_validation_pairs", ""),
    ],
)
def test_resume_is_proposed_where_there_is_a_checkpoint(
    sheet_dataset: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    called: Called,
    place: str,
    fix: str,
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(place, interrupt)
    run = tmp_path / "a run"
    train = ("train", "don", "--data", sheet_dataset.root, "--out", run)
    code, _, error = called(*train, *options(*DON))
    assert code == 130
    assert ("--resume" in error) == bool(fix)
    assert fix.format(run=run) in error


@pytest.mark.parametrize("config", ["steps: 5", "loss: {canonical_weight: 1.0}"])
def test_predict_refuses_a_folder_without_weights(
    sheet_dataset: Dataset, tmp_path: Path, called: Called, config: str
) -> None:
    (tmp_path / "config.yaml").write_text(config + "\n")
    out = tmp_path / "sub.parquet"
    code, _, error = called("predict", tmp_path, "--data", sheet_dataset.root, "--out", out)
    assert code == 1
    assert "no validated weights yet" in error


def test_a_run_is_resumed_with_the_settings_of_its_checkpoint(
    sheet_dataset: Dataset, tmp_path: Path, called: Called
) -> None:
    """What `--resume` reads without settings is config.yaml, which may have been edited since."""
    run = tmp_path / "run"
    train = ("train", "don", "--data", sheet_dataset.root, "--out", run)
    assert called(*train, *options(*DON, "steps=2"))[0] == 0
    config = run / "config.yaml"
    written = config.read_text()
    config.write_text(written.replace("descriptor_dim: 4", "descriptor_dim: 8"))
    code, _, error = called(*train, "--resume")
    assert code == 1
    assert "config.yaml, network.descriptor_dim: a run resumes only with" in error
    assert "found 8; required: 4. Leave --config and --set out and config.yaml as it was" in error
    config.write_text(written.replace("threads: 0", "threads: 1"))
    assert called(*train, "--resume")[0] == 0
    code, _, error = called(*train, "--resume", "--set", "validation.every=9")
    assert code == 1
    assert "config.yaml, validation.every: a run resumes only with" in error
    code, _, error = called("train", "timecycle", *train[2:], "--resume")
    assert code == 1
    assert "run: the run is of another method, or its config was edited" in error
