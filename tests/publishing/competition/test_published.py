"""A rendered dataset, published, uploaded to a platform and scored there: one score everywhere."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pliant.evaluator import evaluate
from pliant.evaluator.competition import flat_scores
from pliant.spec.dataset import Dataset


@pytest.fixture(scope="module")
def published(tiny_dataset: Path, wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that holds the halves `public` and `public-private`."""
    from pliant.cli.main import run

    folder = tmp_path_factory.mktemp("published")
    out = folder / "public"
    options = ["--hold-out", "test", "--answers-are-public", "--bundle", str(wheel)]
    assert run(["publish", str(tiny_dataset), "--out", str(out), *options]) == 0
    return folder


def test_one_score_everywhere(tiny_dataset: Path, published: Path, tmp_path: Path) -> None:
    from pliant.baselines.submission_file import query_keys, write_answers
    from pliant.spec.answers import Answers

    dataset = Dataset.open(tiny_dataset)
    truth = dataset.truth("test")
    true_px = np.stack([truth["u_b"].to_numpy(), truth["v_b"].to_numpy()], axis=1)
    rng = np.random.default_rng(5)
    answers = Answers(
        uv_px=(true_px + rng.normal(0, 4, true_px.shape)).astype(np.float32),
        visible=rng.random(len(true_px)).astype(np.float32),
        sigma_px=rng.uniform(1, 8, len(true_px)).astype(np.float32),
    )
    submission = tmp_path / "mine.parquet"
    public, private = published / "public", published / "public-private"
    # A participant has the public half alone, and writes the very file that fits the whole set.
    keys = query_keys(Dataset.open(public), "test")
    write_answers(submission, Dataset.open(public), "test", keys, answers, {"name": "mine"})

    whole = flat_scores(evaluate(submission, tiny_dataset).document)
    assert {"geodesic_mean_m", "nll", "rope.rmse_px"} <= set(whole)
    assert flat_scores(evaluate(submission, public, truth=private).document) == whole

    with zipfile.ZipFile(private / "codabench" / "codabench-test.zip") as bundle:
        bundle.extractall(tmp_path / "bundle")
    for archive, place in (("scoring_program", "program"), ("reference_data", "input/ref")):
        with zipfile.ZipFile(tmp_path / "bundle" / f"{archive}.zip") as opened:
            opened.extractall(tmp_path / "app" / place)
    (tmp_path / "app/input/res").mkdir()
    (tmp_path / "app/input/res/mine.parquet").write_bytes(submission.read_bytes())
    subprocess.run(
        [sys.executable, "score.py", tmp_path / "app/input", tmp_path / "app/output"],
        cwd=tmp_path / "app/program",
        check=True,
    )
    shown = json.loads((tmp_path / "app/output/scores.json").read_text())
    assert {"rmse_px", "aj", "cloth-3.rmse_px"} <= set(shown)
    assert not {"geodesic_mean_m", "nll"} & set(shown)
    # No error of this submission reaches the cap, so only the rounding differs.
    assert shown == {name: float(f"{whole[name]:.4g}") for name in shown}


def test_public_half_holds_no_bundle(published: Path) -> None:
    assert not list((published / "public").rglob("*.zip"))
    assert (published / "public-private" / "codabench" / "codabench-test.zip").is_file()
    sums = (published / "public-private" / "SHA256SUMS").read_text()
    assert "codabench/codabench-test.zip" in sums


def test_public_half_is_shown_though_some_of_it_has_no_depth(
    published: Path, tmp_path: Path
) -> None:
    from PIL import Image

    from pliant.cli.main import run

    out = tmp_path / "sheet.png"
    assert run(["view", str(published / "public"), "--out", str(out), "--count", "8"]) == 0
    with Image.open(out) as sheet:
        colours = sheet.convert("RGB").getcolors(2**24)
    assert colours is not None
    counts: dict[object, int] = {colour: n for n, colour in colours}
    assert counts[235, 235, 235] > 240 * 90  # what stands for the depth of a held-out frame
