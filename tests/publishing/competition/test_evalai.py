"""The EvalAI challenge, imported and called as EvalAI's worker does it."""

from __future__ import annotations

import json
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import pytest
import yaml

from pliant.evaluator import evaluate
from pliant.evaluator.competition.scoring import flat_scores
from pliant.evaluator.hidden_truth import public_scores

WORKER = """
import importlib, json, sys
annotation, submission = sys.argv[1:]
module = importlib.import_module("challenge_data.challenge_1")
out = module.evaluate(annotation, submission, "test", submission_metadata={"id": 1})
print(json.dumps(out))
"""


@pytest.fixture(scope="module")
def challenge(bundles: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The unpacked challenge, with its evaluation script where the worker puts it."""
    folder = tmp_path_factory.mktemp("challenge")
    with zipfile.ZipFile(bundles / "evalai-test.zip") as archive:
        archive.extractall(folder)
    package = folder / "compute" / "challenge_data" / "challenge_1"
    with zipfile.ZipFile(folder / "evaluation_script.zip") as archive:
        archive.extractall(package)
    (package.parent / "__init__.py").touch()
    return folder


def called(challenge: Path, python: Path, submission: Path) -> subprocess.CompletedProcess[str]:
    config = yaml.safe_load((challenge / "challenge_config.yaml").read_text())
    annotation = challenge / config["challenge_phases"][0]["test_annotation_file"]
    return subprocess.run(
        [str(python), "-c", WORKER, str(annotation), str(submission)],
        cwd=challenge / "compute",
        env={"HOME": str(Path.home())},
        capture_output=True,
        text=True,
    )


def test_result_is_that_of_pliant_evaluate(
    challenge: Path, bare_python: Path, scene: Any, submission: Path
) -> None:
    done = called(challenge, bare_python, submission)
    assert (done.returncode, done.stderr) == (0, "")
    out = json.loads(done.stdout)
    scores = evaluate(submission, scene.root, protocol="standard", hide_truth=True)
    expected = flat_scores(public_scores(scores).document)
    assert out["result"] == [{"test": expected}]
    assert out["submission_result"] == expected


def test_bad_submission_raises_one_sentence(
    challenge: Path, bare_python: Path, scene: Any, tmp_path: Path
) -> None:
    path = scene.submit(tmp_path / "short.parquet", scene.table().slice(1))
    done = called(challenge, bare_python, path)
    assert done.returncode == 1
    assert "ROW_MISSING 1" in done.stderr.strip().splitlines()[-1]


def test_configuration_is_whole(challenge: Path) -> None:
    config = yaml.safe_load((challenge / "challenge_config.yaml").read_text())
    pages = ("description", "evaluation_details", "terms_and_conditions", "submission_guidelines")
    files = [config[name] for name in (*pages, "image", "evaluation_script")]
    (phase,) = config["challenge_phases"]
    for name in [*files, phase["description"], phase["test_annotation_file"]]:
        assert (challenge / name).stat().st_size > 0, name
    for page in (challenge / "templates").iterdir():
        assert page.read_text().startswith("<h1>"), page
    assert "<table>" in (challenge / config["evaluation_details"]).read_text()
    (board,) = config["leaderboard"]
    labels = board["schema"]["labels"]
    assert board["schema"]["default_order_by"] == labels[0] == "rmse_px"
    assert set(board["schema"]["metadata"]) == set(labels)
    (split,) = config["challenge_phase_splits"]
    assert split["is_leaderboard_order_descending"] is False  # RMSE: lower is better
    assert config["dataset_splits"][0]["codename"] == phase["codename"] == "test"


def test_every_label_of_the_leaderboard_is_in_every_result(
    bundles: Path, halves: tuple[Path, Path], scene: Any, submission: Path
) -> None:
    from pliant.evaluator.competition import evalai_program
    from pliant.publishing.competition.facts import describe

    with zipfile.ZipFile(bundles / "evalai-test.zip") as archive:
        annotation = bundles.parent / "annotation.zip"
        annotation.write_bytes(archive.read("annotations/test.zip"))
    result = evalai_program.evaluate(str(annotation), str(submission), "test")["result"]
    keys = [column.key for column in describe(halves[0], "test").columns]
    assert set(keys) <= set(result[0]["test"])
