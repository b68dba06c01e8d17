"""Every script of examples/ runs, and says what its first lines promise."""

from __future__ import annotations

import math
import runpy
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

for _name in ("numba", "torch", "cv2", "rerun", "fastapi"):
    pytest.importorskip(_name)

EXAMPLES = Path(__file__).parents[1] / "examples"
SAYS = {
    "01_first_scene": ("points are seen in both", "dataset"),
    "02_own_rope": ("2 sequences, 0 problems",),
    "03_own_camera_path": ("hidden points: 0% at first", "median difference"),
    "04_score_a_method": ("RMSE 48.0 px", "rope-tracer"),
    "05_sparse_matches": ("the matches themselves",),
    "06_a_tracker": ("Lucas-Kanade", "identity"),
    "07_train_a_small_don": ("after 4 steps", "don-rope, as shipped"),
    "08_export_to_rerun": ("2 recordings",),
    "09_serve_a_challenge": ("Submission 1: scored", "1,Ada's team"),
    "10_score_photographs": ("identity", "sift"),
}
SLOW = {"03", "04", "06", "07", "09"}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.long if name[:2] in SLOW else ()) for name in SAYS],
)
def test_example(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [name, str(tmp_path / "out"), "4"])
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    shown = capfd.readouterr().out
    for text in SAYS[name]:
        assert text in shown


def test_the_largest_move_is_a_distance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["01", str(tmp_path)])
    runpy.run_path(str(EXAMPLES / "01_first_scene.py"), run_name="__main__")
    (table,) = tmp_path.glob("dataset/sequences/*/*/correspondences.parquet")
    places: dict[int, list[tuple[float, float]]] = {}
    for row in pq.read_table(table).to_pylist():
        if row["visibility"] == "visible":
            places.setdefault(row["point"], []).append((row["u_px"], row["v_px"]))
    largest = max(math.dist(*seen) for seen in places.values() if len(seen) == 2)
    assert f"the largest move: {largest:.0f} px" in capfd.readouterr().out


def test_every_example_is_tested_and_listed() -> None:
    names = [path.stem for path in sorted(EXAMPLES.glob("*.py"))]
    assert names == list(SAYS)
    listed = (EXAMPLES / "README.md").read_text()
    assert all(f"({name}.py)" in listed for name in names)
