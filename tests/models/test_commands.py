from __future__ import annotations

import json
from pathlib import Path

import pytest

from pliant.cli.main import run
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_footer
from tests.models.tiny_runs import DON, options


@pytest.mark.long
@pytest.mark.usefixtures("quick_tracing")
def test_train_predict_and_check(
    tiny_dataset: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The whole way: what a run answers passes the submission check, and says how it came about."""
    out, submission = tmp_path / "run", tmp_path / "sub.parquet"
    arguments = ["train", "don", "--data", str(tiny_dataset), "--out", str(out), "--json"]
    assert run([*arguments, *options(*DON, "steps=2", "tier=rope")]) == 0
    report = json.loads(capfd.readouterr().out)
    assert report["steps"] == 2
    assert report["tier"] == "rope"
    assert report["validation"]["rmse_px"] > 0

    predict = ["predict", str(out), "--data", str(tiny_dataset), "--out", str(submission)]
    assert run([*predict, "--split", "val"]) == 0
    assert run(["check", str(submission), "--data", str(tiny_dataset)]) == 0
    method = read_footer(submission)["method"]
    assert method["name"] == "don"
    assert method["answer"]["decode"] == "trace"
    assert method["answer"]["search"] == "mask"
    assert method["mask"] == "given"
    assert method["steps"] == 2


def test_resume_needs_no_settings(sheet_dataset: Dataset, tmp_path: Path) -> None:
    out = tmp_path / "run"
    arguments = ["train", "don", "--data", str(sheet_dataset.root), "--out", str(out)]
    assert run([*arguments, *options(*DON, "steps=2")]) == 0
    assert run([*arguments, "--resume"]) == 0


@pytest.mark.parametrize(
    ("place", "fix"),
    [
        ("pliant.models.training.loop._step", "Interrupted: continue with --resume"),
        ("pliant.models.don.trainer.draw_validation_pairs", ""),
    ],
)
def test_resume_is_proposed_where_there_is_a_checkpoint(
    sheet_dataset: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    place: str,
    fix: str,
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(place, interrupt)
    data, out = str(sheet_dataset.root), str(tmp_path / "run")
    assert run(["train", "don", "--data", data, "--out", out, *options(*DON)]) == 130
    error = capfd.readouterr().err
    assert ("--resume" in error) == bool(fix)
    assert fix in error


@pytest.mark.parametrize("config", ["steps: 5", "loss: {canonical_weight: 1.0}"])
def test_predict_refuses_a_folder_without_weights(
    sheet_dataset: Dataset, tmp_path: Path, capfd: pytest.CaptureFixture[str], config: str
) -> None:
    (tmp_path / "config.yaml").write_text(config + "\n")
    out = str(tmp_path / "sub.parquet")
    assert run(["predict", str(tmp_path), "--data", str(sheet_dataset.root), "--out", out]) == 1
    assert "no validated weights yet" in capfd.readouterr().err
