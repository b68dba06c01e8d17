"""The Codabench bundle, unpacked and run as Codabench does it."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import yaml

from pliant.evaluator import evaluate
from pliant.evaluator.competition import codabench, flat_scores
from pliant.evaluator.hidden_truth import public_scores
from pliant.publishing.competition.bundle import check_wheel, write_bundle
from pliant.spec.errors import CallError, SpecError


@pytest.fixture(scope="module")
def competition(bundles: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The unpacked competition."""
    folder = tmp_path_factory.mktemp("competition")
    with zipfile.ZipFile(bundles / "codabench-test.zip") as archive:
        archive.extractall(folder)
    return folder


class Worker:
    """A compute worker: lays out /app for a scoring step and runs the program's command."""

    def __init__(self, competition: Path, app: Path) -> None:
        self.app = app
        task = yaml.safe_load((competition / "competition.yaml").read_text())["tasks"][0]
        for archive, place in (
            (competition / task["scoring_program"], "program"),
            (competition / task["reference_data"], "input/ref"),
        ):
            with zipfile.ZipFile(archive) as opened:
                opened.extractall(app / place)
        (app / "output").mkdir()

    def put(self, **files: Path | bytes) -> None:
        """Unpack a participant's archive."""
        results = self.app / "input" / "res"
        results.mkdir(parents=True)
        for name, content in files.items():
            data = content if isinstance(content, bytes) else content.read_bytes()
            (results / f"{name}.parquet").write_bytes(data)

    def run(self, **files: Path | bytes) -> subprocess.CompletedProcess[str]:
        self.put(**files)
        command = yaml.safe_load((self.app / "program" / "metadata.yaml").read_text())["command"]
        words = [word.replace("/app/", f"{self.app}/") for word in shlex.split(command)]
        assert words[0] == "python3"
        return subprocess.run(
            [sys.executable, *words[1:]],
            cwd=self.app / "program",
            env={"HOME": str(Path.home()), "PYTHONUNBUFFERED": "1"},
            capture_output=True,
            text=True,
        )


@pytest.fixture
def worker(competition: Path, tmp_path: Path) -> Worker:
    return Worker(competition, tmp_path / "app")


def public_flat(submission: Path, scene: Any) -> dict[str, float]:
    scores = evaluate(submission, scene.root, protocol="standard", hide_truth=True)
    return flat_scores(public_scores(scores).document)


def test_score_is_that_of_pliant_evaluate(worker: Worker, scene: Any, submission: Path) -> None:
    """To the four digits that participants see, of the headline metrics alone."""
    done = worker.run(mine=submission)
    assert (done.returncode, done.stderr) == (0, "")
    output = worker.app / "output"
    assert sorted(p.name for p in output.iterdir()) == ["detailed_results.html", "scores.json"]
    scores = json.loads((output / "scores.json").read_text())
    assert scores == public_flat(submission, scene)
    document = evaluate(submission, scene.root, protocol="standard").document
    assert scores["rmse_px"] == pytest.approx(document["overall"]["rmse_px"], rel=5e-4)
    assert scores["rope.rmse_px"] == pytest.approx(document["tiers"]["rope"]["rmse_px"], rel=5e-4)
    assert not {"geodesic_mean_m", "nll", "cloth.aj"} & set(scores)
    assert all(isinstance(value, float | int) for value in scores.values())  # flat
    assert f"rmse_px {scores['rmse_px']}" in done.stdout
    page = (output / "detailed_results.html").read_text()
    assert "<h1>test</h1>" in page
    assert "All metrics" in page
    assert 'class="pair"' not in page  # rings where the truth lies


def test_leaderboard_columns_are_keys_of_the_scores(
    competition: Path, scene: Any, submission: Path
) -> None:
    document = yaml.safe_load((competition / "competition.yaml").read_text())
    (board,) = document["leaderboards"]
    keys = [column["key"] for column in board["columns"]]
    assert set(keys) == set(public_flat(submission, scene))
    assert keys[0] == "rmse_px"
    assert [column["index"] for column in board["columns"]] == list(range(len(keys)))
    sorting = {column["key"]: column["sorting"] for column in board["columns"]}
    assert (sorting["rmse_px"], sorting["pck_8px"]) == ("asc", "desc")


def test_competition_names_only_files_that_are_there(competition: Path) -> None:
    document = yaml.safe_load((competition / "competition.yaml").read_text())
    assert document["version"] == 2
    assert document["docker_image"].startswith("python:3.11")
    named = [document["image"], document["terms"], document["phases"][0]["starting_kit"]]
    named += [page["file"] for page in document["pages"]]
    named += [document["tasks"][0][part] for part in ("scoring_program", "reference_data")]
    for name in named:
        assert (competition / name).stat().st_size > 0, name
    assert document["phases"][0]["tasks"] == [document["tasks"][0]["index"]]
    for page in (competition / "pages").iterdir():
        text = page.read_text()
        assert text.startswith("# "), page
        assert "{{" not in text, page
        assert "{%" not in text, page


def test_an_unfilled_template_ends_with_one_line_and_no_score(worker: Worker, scene: Any) -> None:
    path = worker.app / "template.parquet"
    scene.submit(path, scene.table(np.full((scene.rows, 2), np.nan)))
    done = worker.run(template=path)
    assert done.returncode == 1
    assert done.stderr.startswith("Error: ")
    assert done.stderr.count("\n") == 1
    assert f"VALUE_NOT_FINITE {2 * scene.rows}" in done.stderr
    assert "row 0 (pair 0, query 0)" in done.stdout  # every cause, in the participants' log
    assert list((worker.app / "output").iterdir()) == []


BAD = {
    "none": "found 0 files named *.parquet; required: one",
    "two": "found 2 files (a.parquet, b.parquet)",
    "damaged": "FILE_UNREADABLE 1",
    "matches": "protocol standard scores submissions of kind answers",
}


@pytest.mark.parametrize("case", BAD)
def test_bad_submission_ends_with_one_line_and_no_score(
    case: str,
    worker: Worker,
    scene: Any,
    submission: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The same program, called in this process."""
    files: dict[str, Path | bytes] = {}
    if case == "two":
        files = {"a": submission, "b": submission}
    elif case == "damaged":
        files = {"a": b"u,v\n1,2\n"}
    elif case == "matches":
        numbers = {name: np.ones(scene.rows) for name in ("u_a", "v_a", "u", "v", "score")}
        table = pa.table({"pair_id": scene.queries["pair_id"], **numbers})
        files = {"a": scene.submit(tmp_path / "matches.parquet", table, kind="matches")}
    worker.put(**files)
    assert codabench([str(worker.app / "input"), str(worker.app / "output")]) == 1
    said = capsys.readouterr().err
    assert said.startswith("Error: ")
    assert said.count("\n") == 1
    assert BAD[case] in said
    assert list((worker.app / "output").iterdir()) == []


def test_starting_kit_makes_a_submission_that_scores(
    competition: Path, tmp_path: Path, scene: Any
) -> None:
    kit = tmp_path / "kit"
    with zipfile.ZipFile(competition / "starting_kit.zip") as archive:
        archive.extractall(kit)
    out = tmp_path / "submission.parquet"
    command = [sys.executable, "submit_without_pliant.py", "data", "test", str(out)]
    subprocess.run(command, cwd=kit, check=True)
    documented = Path(__file__).parents[3] / "docs" / "examples" / "submit_without_pliant.py"
    assert (kit / "submit_without_pliant.py").read_bytes() == documented.read_bytes()
    assert evaluate(out, scene.root).overall["rmse_px"] is not None


def test_nothing_that_participants_get_holds_an_answer(competition: Path, scene: Any) -> None:
    """Of the bundle only the reference data does: not the kit, the pages or the program."""
    with zipfile.ZipFile(competition / "reference_data.zip") as archive:
        assert "truth/test.parquet" in archive.namelist()
        assert not [name for name in archive.namelist() if name.endswith(".png")]
    for name in ("starting_kit.zip", "scoring_program.zip"):
        with zipfile.ZipFile(competition / name) as archive:
            data = b"".join(archive.read(member) for member in archive.namelist())
        assert b"u_b" not in data or name == "scoring_program.zip"  # the code names the column
        for row in (0, scene.rows - 1):
            assert np.float32(scene.true_px[row, 0]).tobytes() not in data


def test_equal_halves_give_equal_bytes(
    halves: tuple[Path, Path], wheel: Path, tmp_path: Path
) -> None:
    first, second = (write_bundle(*halves, wheel, tmp_path / name) for name in "ab")
    assert [path.name for path in first] == ["codabench-test.zip", "README.md"]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == sorted(p.name for p in first)


def test_wrong_calls_are_refused(halves: tuple[Path, Path], wheel: Path, tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="the private half has no truth"):
        write_bundle(halves[0], halves[0], wheel, tmp_path / "out")
    (tmp_path / "pliant-1-py3-none-any.whl").write_text("no archive")
    for path in (tmp_path / "pliant-1-py3-none-any.whl", tmp_path / "gone.whl"):
        with pytest.raises(CallError, match=r"not a wheel of Pliant.*pip wheel --no-deps"):
            check_wheel(path)
