"""The benchmark on real ropes, on drawn ropes whose places are known."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw

from pliant.spec.answers import Answers
from pliant.spec.frame import Pair
from tests.benchmarks.conftest import script

cv2 = pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def benchmark_module() -> Iterator[Any]:
    with script("real_rope") as module:
        yield module


def drawn(path: Path, *, upright: bool = False, background: int = 0) -> Path:
    """A straight rope 10 px wide of 400 px, from a ball of radius 16."""
    picture = Image.new("RGB", (500, 120), (background,) * 3)
    pen = ImageDraw.Draw(picture)
    pen.rectangle([40, 55, 440, 64], fill=(160, 150, 140))
    pen.ellipse([24, 44, 56, 76], fill=(160, 150, 140))
    if upright:
        picture = picture.transpose(Image.Transpose.TRANSPOSE)
    picture.save(path)
    return path


def test_places_run_from_the_ball_to_the_free_end(tmp_path: Path, benchmark_module: Any) -> None:
    rope = benchmark_module.read_rope(drawn(tmp_path / "a.png", background=250), None, 12)
    # From the ball's edge at u = 56 or a little beyond, to the end at u = 441.
    assert rope.length_px == pytest.approx(385, abs=8)
    u, v = rope.at_px[:5].T
    assert v == pytest.approx(np.full(5, 60), abs=1.5)
    start = 441 - rope.length_px
    assert u == pytest.approx(start + rope.length_px * np.arange(1, 6) / 6, abs=4)


def test_a_hole_does_not_move_the_middle_of_the_rope(tmp_path: Path, benchmark_module: Any) -> None:
    whole = benchmark_module.read_rope(drawn(tmp_path / "a.png"), None, 12)
    pierced = Image.open(drawn(tmp_path / "b.png"))
    u, v = whole.at_px[2].astype(int)
    ImageDraw.Draw(pierced).rectangle([u - 12, v - 3, u + 3, v + 2], fill=(0, 0, 0))
    pierced.save(tmp_path / "b.png")
    found = benchmark_module.read_rope(tmp_path / "b.png", None, 12)
    assert found.at_px == pytest.approx(whole.at_px, abs=0.01)


def test_geodesic_steps(benchmark_module: Any) -> None:
    """By hand: round a wall of 5 x 5, and one diagonal step."""
    mask = np.array([[1, 1, 0], [0, 1, 0], [0, 1, 1]], bool)
    found = benchmark_module.geodesic(mask, 0)
    straight = [0, 1, np.sqrt(2), np.sqrt(2) + 1, np.sqrt(2) + np.sqrt(2)]
    assert found == pytest.approx(straight)


class Known:
    """Answers a place along the drawn ropes exactly, or moved along the rope."""

    name = "known"

    def __init__(self, ropes: dict[str, Any], by_px: float = 0.0) -> None:
        self.ropes, self.by_px = ropes, by_px

    def answer(self, pair: Pair) -> Answers:
        answers = self.ropes[pair.target.key].at_px.copy()
        answers[:, 0] -= self.by_px
        return Answers(answers)


def test_scores_by_hand(tmp_path: Path, benchmark_module: Any) -> None:
    files = [drawn(tmp_path / f"{name}.png") for name in "ab"]
    ropes = [benchmark_module.read_rope(file, None, 12) for file in files]
    by_key = {rope.view.key: rope for rope in ropes}
    exact = benchmark_module.score(ropes, Known(by_key), [(0, 1), (1, 0)])
    band = 3 / ropes[0].length_px
    assert exact["arc_error_median"] == pytest.approx(0, abs=band)
    assert {value for key, value in exact.items() if key != "arc_error_median"} == {1.0}
    moved = benchmark_module.score(ropes, Known(by_key, 15.0), [(0, 1)])
    assert moved["arc_error_median"] == pytest.approx(15 / ropes[0].length_px, abs=band)
    assert moved["share_within_20_px"] == 1.0
    assert moved["share_within_3_percent"] == 0.0
    assert moved["share_within_5_percent"] == 1.0


def test_a_picture_without_a_ball_is_left_out(
    tmp_path: Path, benchmark_module: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn(tmp_path / "a.png")
    drawn(tmp_path / "b.png", upright=True)
    bare = Image.new("RGB", (300, 60))
    ImageDraw.Draw(bare).rectangle([10, 25, 290, 34], fill="white")
    bare.save(tmp_path / "c.png")
    figures = benchmark_module.measure(tmp_path, ["random"], None, 12, False)
    assert figures["pictures"] == 2
    assert figures["pairs"] == 2
    assert figures["share_on_rope"] == 1.0
    assert "c.png: the rope has no ball" in capsys.readouterr().out
