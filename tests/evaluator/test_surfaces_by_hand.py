"""Surface images of a few pixels: what they say about answers, matches and workers."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pliant.evaluator import evaluate
from pliant.evaluator.metrics import surface_images, surfaces
from pliant.evaluator.metrics.matches import Matches, MatchesSettings, match_blocks
from pliant.evaluator.metrics.surface_images import (
    ObjectSurface,
    dense_truth,
    farthest_material_m,
    neighbour_steps_m,
    typical_step_m,
)
from pliant.evaluator.metrics.surfaces import SurfaceFacts, Surfaces
from pliant.evaluator.submission.answers import PlacedMatches
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.exr import read_surface
from pliant.spec.model import MaterialCoordinate, MaterialObject
from pliant.spec.storage import layout
from tests.evaluator.hand_made import Split, split

NAN = math.nan
HALF = MaterialCoordinate("s", 0.0, 40.0, 0.5)  # half a metre per unit
WIDE = MaterialCoordinate("s", 0.0, 40.0, 2.0)
SHEET = MaterialObject(1, "sheet", (HALF, HALF))


def surface(m0: Any, m1: Any = None) -> ObjectSurface:
    """Return a surface from material coordinates; NaN is off the object."""
    first = np.asarray(m0, np.float32)
    second = np.zeros_like(first) if m1 is None else np.asarray(m1, np.float32)
    return ObjectSurface(~np.isnan(first), np.nan_to_num(first), second)


def test_what_neighbouring_pixels_span() -> None:
    made = surface([[0, 1, NAN], [4, 7, 7], [NAN, 7, 9]], [[0, 0, 5], [0, 4, 4], [5, 8, 8]])
    np.testing.assert_array_equal(
        made.material(np.array([1, 2]), np.array([1, 2])), [[7, 4], [9, 8]]
    )
    across, down = (step_m for *_, step_m in neighbour_steps_m(made, SHEET))
    np.testing.assert_allclose(across, [0.5, 2.5, 0, 1])
    np.testing.assert_allclose(down, [2, math.sqrt(13), 2, math.sqrt(5)])
    # Of 0.5, 1, 2, 2, sqrt(5), 2.5, sqrt(13).
    assert typical_step_m(made, SHEET) == 2
    assert typical_step_m(surface([[0, 8, 8, 8]]), SHEET) == 4  # equal ones do not count


def test_the_farthest_that_two_points_can_be_apart() -> None:
    assert farthest_material_m(SHEET) == pytest.approx(20 * math.sqrt(2))
    angle = MaterialCoordinate("theta", -3.0, 3.0, 2.0, 6.0)
    shifted = MaterialCoordinate("s", 1.0, 5.0, 2.0)
    assert farthest_material_m(MaterialObject(1, "rope", (shifted, angle))) == math.hypot(8, 6)


class Dataset:
    """Sequences `s`, `r` and `q` of the tier `t`, `z` of `w`; `r` has no points, `q` no images."""

    root = Path("data")

    def __init__(self) -> None:
        self.read: list[str] = []
        self.tiers = {"t": SimpleNamespace(queried=SHEET)}
        self.material = {"m0": [0.0, 1, 2, 3], "m1": [0.0, 0, 0, 4]}

    def sequence(self, name: str) -> Any:
        def points() -> pa.Table:
            self.read.append(name)
            return pa.table(self.material)

        return SimpleNamespace(
            tier="w" if name == "z" else "t", dir=Path(name), points=points, size=(4, 3),
            has=lambda file: name in "sz" or name == ("q" if "points" in file else "r"),
            file=lambda file: Path(name) / file, described=SimpleNamespace(queried_object=1),
        )  # fmt: skip


# Material 0, 1 and 2 in the middle row; 8 in a corner, which no pixel touches.
SEEN = surface([[NAN, NAN, NAN, NAN, 8], [0, 1, 2, NAN, NAN], [NAN] * 5])


def facts_of(
    answer_px: Any, *, hidden: Any = (), point: Any = None, **options: Any
) -> SurfaceFacts:
    """Return what SEEN says of answers to the material point 1, which is at (1.5, 1.5)."""
    count = len(answer_px)
    made = Split(split([count]), answer_px, [[1.5, 1.5]] * count, hidden)
    found: Any = Surfaces(Dataset(), **options)  # type: ignore[arg-type]
    found.frame = lambda *_: SEEN
    points = np.ones(count, np.int64) if point is None else np.array(point)
    facts: SurfaceFacts = found.facts(made.block(0, 1, point=points), made.queries)
    return facts


# On the object; 0.9 px from it; 1 px; 1.01 px; outside the image; missing; of a hidden point.
ANSWERS = [[2.5, 1.5], [0.5, 2.4], [3.5, 1.5], [3.51, 1.5], [2.5, 3.1], [NAN, NAN], [1.5, 1.5]]


def test_what_surfaces_say_about_answers() -> None:
    found = facts_of(ANSWERS, hidden=[6], search_px=0, reach_px=1.0, silhouettes=True)
    assert found.known.tolist() == [True] * 6 + [False]
    assert found.on_object.tolist() == [True] + [False] * 6
    farthest = 20 * math.sqrt(2)
    np.testing.assert_allclose(found.geodesic_m, [0.5, NAN, NAN, NAN, NAN, farthest, NAN])
    np.testing.assert_allclose(found.silhouette_px, [1] * 6 + [NAN])
    steps = [0.5, -0.5, 0.5, NAN, NAN, NAN, NAN]
    np.testing.assert_allclose(found.steps_m[:, 0], steps)
    np.testing.assert_allclose(found.steps_m[:, 1], np.array(steps) * 0)
    np.testing.assert_allclose(found.pixel_m, [0.5] * 6 + [NAN])


def test_what_is_not_wanted_is_not_looked_up() -> None:
    found = facts_of(ANSWERS[:3], search_px=1)
    assert found.on_object.tolist() == [True] * 3
    np.testing.assert_allclose(found.geodesic_m, [0.5, 0.5, 0.5])
    for values in (found.silhouette_px, found.steps_m, found.pixel_m):
        assert np.isnan(values).all()
    inside = facts_of(ANSWERS[:1], reach_px=1.0)
    assert inside.steps_m.tolist() == [[0.5, 0]]
    assert not facts_of(ANSWERS[:2], hidden=[0, 1]).known.any()
    assert facts_of([[NAN, NAN]], point=[9]).known.tolist() == [True]


def test_a_reach_need_not_be_whole_pixels() -> None:
    """The middle of the last pixel of the object is 0.7 px from the answer, in the next pixel."""
    near, far = (facts_of([[3.2, 1.5]], search_px=0, reach_px=reach) for reach in (0.75, 0.65))
    assert not near.on_object[0]
    assert near.steps_m.tolist() == [[0.5, 0]]
    assert np.isnan(far.steps_m).all()


def test_points_that_the_table_has_not() -> None:
    on = [[1.5, 1.5], [1.5, 1.5]]
    assert facts_of(on, point=[0, 3]).geodesic_m.tolist() == [0.5, math.hypot(1, 2)]
    for points, found in (([0, 4], 4), ([-1, 2], 2)):
        with pytest.raises(SpecError, match=f"found {found}; required: 0 to 3"):
            facts_of(on, point=points)


def test_each_target_frame_has_its_own_surface_and_object() -> None:
    """Pairs in `s` of two tiers, in `r`, which has no points, and in `q`, which has no images."""
    queries = split(
        [1, 2, 1, 1, 1, 1], tiers=["t", "w"], tier=[0, 1, 0, 0, 0, 1],
        sequences=["s", "r", "q", "z"], sequence_b=[0, 3, 1, 2, 0, 3], frame_b=[1, 1, 1, 1, 2, 1],
    )  # fmt: skip
    answer_px = [[0, 0], [0.5, 1.5], [2.5, 1.5], [2.5, 1.5], [2.5, 1.5], [0.5, 0.5], [2.5, 1.5]]
    made = Split(queries, answer_px, [[1.5, 1.5]] * 7, point=np.ones(7, np.int64))
    dataset = Dataset()
    dataset.tiers["w"] = SimpleNamespace(queried=MaterialObject(1, "w", (WIDE, WIDE)))
    found: Any = Surfaces(dataset)  # type: ignore[arg-type]
    other = surface([[3.0, NAN]])
    asked = []

    def frame(name: str, number: int) -> ObjectSurface | None:
        asked.append((name, number))
        return {("q", 1): None, ("s", 2): other}.get((name, number), SEEN)

    found.frame = frame
    block = made.block(1, 6)
    facts = found.facts(block, queries)
    assert facts.known.tolist() == [True, True, False, False, True, True]
    np.testing.assert_allclose(facts.geodesic_m, [2, 2, NAN, NAN, 1, 2])
    assert asked == [("z", 1), ("q", 1), ("s", 2)]
    assert found.facts(block, queries) is facts
    assert len(asked) == 3
    kept = made.block(0, 1)
    found.keep(kept, facts)
    assert found.facts(kept, queries) is facts
    nothing = found.facts(made.block(0, 1, point=None), queries)
    assert not nothing.known.any()
    assert np.isnan(nothing.geodesic_m).all()


def test_points_are_read_once_per_tier() -> None:
    dataset = Dataset()
    found = Surfaces(dataset)  # type: ignore[arg-type]
    assert found.point_material("r") is None
    first = found.point_material("s")
    assert first is not None
    np.testing.assert_array_equal(first, [[0, 0], [1, 0], [2, 0], [3, 4]])
    assert found.point_material("r") is found.point_material("s") is first
    assert dataset.read == ["s"]
    with pytest.raises(SpecError, match=f"q/{layout.depth_name(1)}: .* and one is missing"):
        found.needed_frame("q", 1)


def test_a_surface_in_the_cache_is_read_only(scene: Any) -> None:
    found = Surfaces(scene.dataset).frame("cloth-test-000000", 1)
    assert found is not None
    assert not found.m0.flags.writeable
    assert found.on_object.sum() == pytest.approx(96 * 60, rel=0.02)


def test_the_truth_of_dense_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of 0.5 m, one of 4 m, eight times the typical one, and a fold of 4.5 m."""
    target = surface([[NAN, 0, 1, 2, 3, 11, 20, NAN], [NAN] * 8])
    footprint = surface_images._footprint_m(target, SHEET)
    np.testing.assert_allclose(footprint[0], [0, 0.5, 0.5, 0.5, 4, 4, 0.5, 0])
    assert not footprint[1].any()
    upright = ObjectSurface(target.on_object.T, target.m0.T, target.m1.T)
    np.testing.assert_array_equal(surface_images._footprint_m(upright, SHEET), footprint.T)
    source = surface([[1.5, 7, 15, 15.5, 19, NAN], [NAN, 18.9, 0.1, 2.9, NAN, 20]])
    uv_a_px = np.array([[u + 0.5, v + 0.5] for v in (0, 1) for u in range(6)])
    on = [True] * 5 + [False, False] + [True] * 3 + [False, True]
    u = [2.5, 4.5, 5.5, NAN, NAN, NAN, NAN, NAN, 1.5, 4.5, NAN, 6.5]
    for cells in (1 << 21, 6 * 4 + 5, 1):
        monkeypatch.setattr(surface_images, "_CHUNK_CELLS", cells)
        found = dense_truth(source, target, uv_a_px, SHEET, 0.5)
        assert found.on_object.tolist() == on
        np.testing.assert_array_equal(found.uv_b_px[:, 0], u)
        assert found.visible.tolist() == (~np.isnan(u)).tolist()
        assert (found.uv_b_px[found.visible, 1] == 0.5).all()
    nowhere = dense_truth(source, surface([[NAN]]), uv_a_px, SHEET, 0.5)
    assert not nowhere.visible.any()


def test_matches_by_hand() -> None:
    """No match of pair 0; on the object and not; a target that hides material 2."""
    queries = split(
        [3, 3, 3], sequences=["s", "r"], sequence_a=[0, 0, 1], sequence_b=[0, 1, 0],
        frame_a=[0, 4, 0], frame_b=[0, 5, 0],
    )  # fmt: skip
    found = PlacedMatches(
        np.array([0, 0, 3, 4]), np.array([[1.5, 1.5], [2.5, 1.5], [3.5, 0.5], [0.5, 1.5]]),
        np.array([[1.2, 0.5], [2.5, 0.5], [1.5, 0.5], [0.5, 1.2]]),
    )  # fmt: skip
    half = surface([[0, 1, NAN], [NAN] * 3])
    frames: Any = {("s", 4): SEEN, ("r", 5): half, ("r", 0): half, ("s", 0): SEEN}
    made = Split(queries, np.zeros((9, 2)), surfaces=SimpleNamespace(
        needed_frame=lambda *place: frames[place], queried=lambda _: SHEET,
    ))  # fmt: skip
    first, second = match_blocks(found, made.context, 0.5)
    assert (first.first_row, first.first_pair, first.starts.tolist()) == (0, 1, [0, 3])
    assert (second.first_row, second.first_pair, second.starts.tolist()) == (3, 2, [0, 1])
    assert first.state.tolist() == [0, 2, 2]
    np.testing.assert_array_equal(first.true_px, [[1.5, 0.5], [NAN, NAN], [NAN, NAN]])
    np.testing.assert_array_equal(first.answer_px, found.uv_b_px[:3])
    assert first.source_on_object is not None
    assert first.target_on_object is not None
    assert first.source_on_object.tolist() == [True, True, False]
    assert first.target_on_object.tolist() == [True, False, True]
    assert (first.missing, first.missing_px) == (None, 50)
    assert second.state.tolist() == [2]  # row 1 of `half` is empty
    metric = Matches(MatchesSettings(visible_within_footprints=0.5), made.context)
    for block in (first, second, made.block(0, 1)):
        metric.update(block)
    assert made.column("matches") == [0, 3, 1]
    assert made.column("on_object") == [0, 2, 0]
    assert made.column("target_on_object") == [0, 1, 0]
    made.context.table.put("counted", slice(0, 3), np.array([0, 1, 2]))
    metric.finish(None, None)  # type: ignore[arg-type]
    assert made.column("matched") == [0, 1, 1]


def test_worker_processes_look_up_a_few_blocks_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks are read 2 per worker ahead, without what the workers do not need."""
    monkeypatch.setattr(
        surfaces, "ProcessPoolExecutor",
        lambda workers, mp_context, **more: ThreadPoolExecutor(workers, **more),
    )  # fmt: skip
    made = Split(split([1] * 7), np.zeros((7, 2)), box_px=np.ones(7), uv_a_px=np.ones((7, 2)))
    blocks, kept = [made.block(pair, pair + 1) for pair in range(7)], {}
    stand_in: Any = SimpleNamespace(
        facts=lambda block, queries: (block.first_pair, queries is made.queries, block.box_px),
        keep=lambda block, facts: kept.update({block.first_pair: facts}),
    )
    monkeypatch.setattr(surfaces, "_process_surfaces", None)
    with pytest.raises(RuntimeError, match="was not started"):
        surfaces._look_up_in_process(blocks[0])
    rest = iter(blocks)
    ahead = surfaces.prefetched(rest, stand_in, made.queries, 2)
    assert next(ahead) is blocks[0]
    assert next(rest) is blocks[5]
    assert list(ahead) == [*blocks[1:5], blocks[6]]
    assert kept == {pair: (pair, True, None) for pair in (0, 1, 2, 3, 4, 6)}


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
