"""What surface images say about answers, found once per target frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.evaluator import evaluate
from pliant.evaluator.metrics import surface_images, surfaces
from pliant.spec.errors import CallError
from pliant.spec.io.exr import read_surface


def nearest_by_hand(on: np.ndarray, uv: np.ndarray, search: int) -> tuple[int, int] | None:
    """Return (row, column) of the nearest pixel of the object by trying all in the window."""
    row, column = (int(np.floor(each)) for each in uv[::-1])
    if not (0 <= row < on.shape[0] and 0 <= column < on.shape[1]):
        return None
    if on[row, column]:
        return row, column
    inside = [
        (r, c)
        for r in range(max(row - search, 0), min(row + search + 1, on.shape[0]))
        for c in range(max(column - search, 0), min(column + search + 1, on.shape[1]))
        if on[r, c]
    ]
    return min(
        inside,
        key=lambda at: (at[1] + 0.5 - uv[0]) ** 2 + (at[0] + 0.5 - uv[1]) ** 2,
        default=None,
    )


@pytest.mark.parametrize("search", [0, 1, 4])
def test_the_nearest_pixel_is_that_of_a_search_by_hand(search: int) -> None:
    rng = np.random.default_rng(search)
    for share in (0.0, 0.03, 0.5):
        on = rng.random((12, 17)) < share
        uv = np.round(rng.uniform(-2, 19, (80, 2)) * 4) / 4  # many ties
        row, column, found = surface_images.nearest_object_pixel(on, uv, search)
        assert not row[~found].any()
        assert not column[~found].any()
        for index, at in enumerate(uv):
            expected = nearest_by_hand(on, at, search)
            assert found[index] == (expected is not None)
            if expected is not None:
                assert (row[index], column[index]) == expected


def test_a_target_frame_is_read_once(
    scene_maker: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scene_maker(tmp_path / "data", sequences=2, frames=5, temporal=True, sources=2)
    path = scene.submit(tmp_path / "s.parquet")
    read: list[str] = []
    whole = read_surface

    def counted(file: Any, **options: Any) -> Any:
        read.append(str(file))
        return whole(file, **options)

    monkeypatch.setattr(surfaces, "read_surface", counted)
    monkeypatch.setattr(surfaces, "_CACHED_FRAMES", 1)
    scores = evaluate(path, scene.root)
    queries = scene.queries.to_pydict()
    targets = set(zip(queries["sequence_b"], queries["frame_b"], strict=True))
    assert len(read) == len(set(read)) == len(targets) < len(scores.per_pair)


def test_silhouettes_are_left_out_where_no_figure_needs_them(
    scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> Any:
        raise AssertionError("a distance to the silhouette was computed")

    path = scene.submit(tmp_path / "s.parquet")
    monkeypatch.setattr(surfaces, "silhouette_distance_px", refuse)
    evaluate(path, scene.root, protocol="paper")
    with pytest.raises(AssertionError, match="silhouette"):
        evaluate(path, scene.root)


def test_worker_processes_change_no_byte(scene: Any, tmp_path: Path) -> None:
    path = scene.submit(tmp_path / "s.parquet", scene.table(scene.true_px + 3.0))
    for workers in (1, 2):
        (tmp_path / str(workers)).mkdir()
        evaluate(path, scene.root, workers=workers).write(tmp_path / str(workers), "")
    for name in ("scores.json", "per_pair.parquet"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_the_number_of_workers_is_checked(scene: Any, tmp_path: Path) -> None:
    with pytest.raises(CallError, match="workers"):
        evaluate(tmp_path / "s.parquet", scene.root, workers=0)
