"""Warnings about valid answers that look like a mistake, and what is never shown of them."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.feather
import pyarrow.parquet as pq
import pytest

from pliant.cli.main import run
from pliant.evaluator import evaluate, inspect, write_report
from pliant.evaluator.controls import Controls
from tests.evaluator.hand_made import Split, split

WIDTH, HEIGHT = 160, 120


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda uv: uv[:, ::-1], "exchanging u and v"),
        (lambda uv: uv - 0.5, "adding half a pixel"),
        (lambda uv: uv + 0.5, "subtracting half a pixel"),
        (lambda uv: uv * [1, -1] + [0, HEIGHT], "flipping v"),
        (lambda uv: uv * [-1, 1] + [WIDTH, 0], "flipping u"),
        (lambda uv: uv * [0.5, 0.5], "multiplying u by 2 and v by 2"),
        (lambda uv: uv * [4, 3], "multiplying u by 0.25 and v by 0.3333"),
        (lambda uv: uv / [WIDTH, HEIGHT], "multiplying by the image size"),
        (lambda uv: uv / [WIDTH, HEIGHT] * 2 - 1, "reading -1 to 1"),
    ],
)
def test_a_mistake_in_the_coordinates_is_named(
    change: Any, says: str, scene: Any, tmp_path: Path
) -> None:
    hints = scene.score(tmp_path, scene.table(change(scene.true_px)), protocol="paper").hints
    assert any(hint.startswith(says) for hint in hints), hints


@pytest.mark.parametrize("error_px", [0.0, 0.3, 1.0, 20.0, 200.0])
def test_right_and_merely_bad_answers_get_no_hint_of_a_mistake(
    error_px: float, scene: Any, tmp_path: Path
) -> None:
    uv = scene.true_px + np.random.default_rng(0).normal(0, error_px, scene.true_px.shape)
    visible = np.where(scene.visible, 0.9, 0.1)
    hints = scene.score(tmp_path, scene.table(uv, visible=visible), protocol="paper").hints
    assert not [hint for hint in hints if "outside" not in hint]


def test_visibility_the_wrong_way_round_is_named(scene: Any, tmp_path: Path) -> None:
    visible = np.where(scene.visible, 0.1, 0.9)
    (hint,) = scene.score(tmp_path, scene.table(visible=visible)).hints
    assert "`visible` is anticorrelated with the truth (-1.00)" in hint


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda uv: uv / [WIDTH, HEIGHT], "100 % of the answers are in [0, 1]"),
        (lambda uv: uv + 500, "100 % of the answers are outside the image"),
    ],
)
def test_check_needs_no_truth_to_warn(
    change: Any, says: str, scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = scene.submit(tmp_path / "s.parquet", scene.table(change(scene.true_px)))
    problems = inspect(path, scene.root)
    assert not problems
    assert len(problems.hints) == 1
    assert problems.hints[0].startswith(says)
    assert run(["check", str(path), "--data", str(scene.root)]) == 0
    assert f"Warning: {says}" in capsys.readouterr().out
    assert run(["check", str(path), "--data", str(scene.root), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warnings"] == problems.hints


def test_hints_that_need_the_truth_are_on_the_terminal_of_its_owner_alone(
    scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A challenge shows participants files and pages alone; the hints would give answers away."""
    path = scene.submit(tmp_path / "s.parquet", scene.table(scene.true_px - 0.5))
    scores = evaluate(path, scene.root)
    assert scores.hints
    assert inspect(path, scene.root).hints == []
    assert evaluate(path, scene.root, hide_truth=True).hints == ()
    write_report(scores, tmp_path / "report", data=scene.root)
    for file in (tmp_path / "report").iterdir():
        assert b"half a pixel to u" not in file.read_bytes()
    assert run(["evaluate", str(path), "--data", str(scene.root)]) == 0
    shown = capsys.readouterr()
    assert "Warning: adding half a pixel" in shown.err
    assert "half a pixel" not in shown.out
    assert run(["evaluate", str(path), "--data", str(scene.root), "--hide-truth"]) == 0
    assert "half a pixel" not in capsys.readouterr().err


def _zipped(scene: Any, path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("submission.parquet", b"x")


def _saved(scene: Any, path: Path) -> None:
    with path.open("wb") as stream:
        np.save(stream, scene.true_px)


@pytest.mark.parametrize(
    ("write", "says"),
    [
        (lambda s, p: pa.csv.write_csv(s.table(), p), "this is a CSV file"),
        (lambda s, p: p.write_text('{"u": [1]}'), "this is a JSON file"),
        (lambda s, p: p.write_text("größe " * 2000), "this is a text file"),
        (_zipped, "this is a zip archive"),
        (_saved, "this is a NumPy .npy file"),
        (lambda s, p: pa.feather.write_feather(s.table(), str(p)), "this is an Arrow"),
        (lambda s, p: p.write_bytes(b""), "the file is empty"),
        (lambda s, p: p.write_bytes(b"\x89PNG\r\n\x1a\n"), "this is a PNG image"),
    ],
)
def test_other_files_are_recognised(write: Any, says: str, scene: Any, tmp_path: Path) -> None:
    path = tmp_path / "s.parquet"
    write(scene, path)
    (issue,) = inspect(path, scene.root).issues()
    assert issue.code == "FILE_UNREADABLE"
    assert issue.message.startswith(says)
    assert "pliant submission ANSWERS --data DATA" in issue.message


def test_a_missing_footer_is_said_once_with_the_command_that_writes_it(
    scene: Any, tmp_path: Path
) -> None:
    pq.write_table(scene.table(), tmp_path / "s.parquet")
    (issue,) = inspect(tmp_path / "s.parquet", scene.root).issues()
    assert issue.code == "FOOTER_MISSING"
    assert issue.message.count("footer") == 1
    assert issue.message.endswith(
        "becomes one by: pliant submission ANSWERS --data DATA --out SUB.parquet"
    )


@pytest.mark.parametrize("version", ["1.0", "1", 1.0, None, ""])
def test_a_version_that_is_not_three_numbers_is_explained(
    version: object, scene: Any, tmp_path: Path
) -> None:
    path = scene.submit(tmp_path / "s.parquet", spec_version=version)
    (issue,) = inspect(path, scene.root).issues()
    assert issue.code == "SPEC_VERSION_UNSUPPORTED"
    assert f"found {version!r}; required: text of three numbers, such as '1.0.0'" in issue.message
    assert "migrate" not in issue.message


# Two pairs. Pair 0: one point. Pair 1: three visible points on a line, 10 px apart, and a hidden
# one. All of them move by (3, 4) from the source to the target, so `identity` errs by 5 px.
TRUE = np.array([[7, 8], [10, 20], [20, 20], [30, 20], [500, 500]], float)


def said(
    error_px: float, *, moved: tuple[float, float] = (3, 4), method: str = "sift"
) -> str | None:
    answer_px = TRUE + np.array([error_px, 0])
    made = Split(split([1, 4]), answer_px, TRUE, hidden=[4], uv_a_px=TRUE - moved)
    controls = Controls(5)
    controls.update(made.block(0, 2))
    return controls.sentence(method)


def test_a_better_method_gets_no_note() -> None:
    assert said(4.0) is None
    assert said(5.0) is None  # as good as standing still


def test_standing_still_is_named_with_its_errors() -> None:
    sentence = said(8.0) or ""
    assert "the control `identity` is better (RMSE 5 px against 8 px, median error 5 px" in sentence
    assert "standing still" in sentence
    assert "centroid" not in sentence


@pytest.mark.parametrize(("control", "errors"), [
    # The other two points' middle: 15, 0 and 15 px; the only point of pair 0 counts as answered.
    ("centroid", f"RMSE {np.sqrt(2050 / 4):.3g} px against 40 px, median error 15 px"),
    # The next point, round and round: 10, 10 and 20 px.
    ("random", f"RMSE {np.sqrt(2200 / 4):.3g} px against 40 px, median error 15 px"),
])  # fmt: skip
def test_places_on_the_object_are_compared(control: str, errors: str) -> None:
    sentence = said(40.0, moved=(300, 400)) or ""
    assert f"the control `{control}` is better ({errors}" in sentence
    assert "identity" not in sentence


def test_a_control_is_not_compared_with_itself() -> None:
    assert said(8.0, method="identity") is None
