"""The classical methods on cards whose motion is known, and on images with nothing to see."""

from __future__ import annotations

import pickle
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.baselines import METHODS, Frame, HeatMatcher, KeypointMatcher, Pair
from pliant.baselines.features.local_features import LocalFeatureMatcher
from pliant.baselines.methods import local_feature
from pliant.baselines.shared_cache import SharedCache
from pliant.spec.errors import MissingExtraError
from tests.baselines.cards import CARD_QUERIES, Motion, Similarity, card_view
from tests.known import known

CLASSICAL = ("sift", "surf", "orb")


def method(name: str) -> LocalFeatureMatcher:
    matcher = METHODS[name]()
    assert isinstance(matcher, LocalFeatureMatcher)
    return matcher


@pytest.mark.parametrize(("name", "median_px"), [("sift", 0.8), ("orb", 0.8), ("surf", 1.5)])
@pytest.mark.parametrize(
    "motion",
    [
        pytest.param({"centre": (127.3, 95.4)}, marks=pytest.mark.long),
        pytest.param({"angle_deg": 40, "centre": (121.7, 98.2)}, marks=pytest.mark.long),
        {"angle_deg": -115, "scale": 1.05, "centre": (117.4, 101.8)},
    ],
    ids=["slide", "turn", "turn and grow"],
)
def test_answers_follow_a_similarity(name: str, median_px: float, motion: dict[str, Any]) -> None:
    moved = Motion(Similarity(), Similarity(**motion))
    error_px = moved.error(method(name).answer(moved.pair).uv_px)
    assert np.median(error_px) < median_px
    assert (error_px < 3).mean() > 0.8


@pytest.mark.parametrize(("name", "least"), [("sift", 0.98), ("orb", 0.9), ("surf", 0.8)])
def test_keypoint_matches_follow_a_similarity(name: str, least: float) -> None:
    moved = Motion(Similarity(), Similarity(angle_deg=45, centre=(121.7, 98.2)))
    found = method(name).match(moved.source, moved.target)
    expected = moved.move(found.uv_a_px.astype(np.float64))
    right = np.hypot(*(found.uv_b_px - expected).T) < 3
    assert len(right) > 25
    assert right.mean() > least
    assert (np.abs(moved.before.locate(found.uv_a_px)) < 64).all()
    assert found.score.dtype == found.uv_a_px.dtype == found.uv_b_px.dtype == np.float32


@pytest.mark.parametrize("name", CLASSICAL)
def test_keypoints_beside_the_object_are_left_out(name: str) -> None:
    view = card_view(Similarity())
    bare = Frame(rgb=view.rgb)
    left = Frame(rgb=view.rgb, mask=np.zeros(view.rgb.shape[:2], dtype=np.bool_))
    left.mask[:, :120] = True  # type: ignore[index]
    assert (method(name).match(left, bare).uv_a_px[:, 0] < 120).all()
    assert (method(name).match(bare, left).uv_b_px[:, 0] < 120).all()
    assert (method(name).match(bare, bare).uv_a_px[:, 0] > 120).any()


def grey_view(height: int, width: int, mask: bool | None = None) -> Frame:
    rgb = np.full((height, width, 3), 127, dtype=np.uint8)
    return Frame(rgb, None if mask is None else np.full((height, width), mask))


@pytest.mark.parametrize("name", CLASSICAL)
@pytest.mark.parametrize("size", [(1, 1), (2, 9), (31, 40), (48, 64)])
@pytest.mark.parametrize("mask", [None, True, False])
def test_blank_and_tiny_images_are_answered(
    name: str, size: tuple[int, int], mask: bool | None
) -> None:
    view = grey_view(*size, mask)
    matcher = method(name)
    queries = np.array([[0.5, 0.5], [0.25, 0.75]], dtype=np.float32)
    answers = matcher.answer(Pair(view, view, queries))
    assert answers.uv_px.tolist() == [[size[1] / 2, size[0] / 2]] * 2  # the mask's centroid
    assert len(matcher.match(view, view).score) == 0
    heat = matcher.heat(view, view, queries[0])
    assert np.isnan(heat.values).all() == (mask is False)
    assert heat.confidence == 0


@pytest.mark.parametrize("name", CLASSICAL)
def test_object_of_one_pixel_is_the_answer(name: str) -> None:
    view = card_view(Similarity())
    speck = np.zeros(view.rgb.shape[:2], dtype=np.bool_)
    speck[60, 90] = True
    answers = method(name).answer(
        Pair(view, Frame(view.rgb, speck), np.array([[120, 100]], dtype=np.float32))
    )
    assert answers.uv_px.tolist() == [[90.5, 60.5]]


@pytest.mark.parametrize("name", CLASSICAL)
def test_queries_at_the_border_are_described(name: str) -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (50, 60, 3)).astype(np.uint8)
    corners = np.array([[0.5, 0.5], [59.5, 0.5], [0.5, 49.5], [59.5, 49.5]], dtype=np.float32)
    answers = method(name).answer(Pair(Frame(rgb), Frame(rgb), corners))
    assert np.array_equal(answers.uv_px, corners)


@pytest.mark.parametrize("name", CLASSICAL)
def test_large_objects_are_searched_on_a_grid(name: str) -> None:
    rng = np.random.default_rng(0)
    rgb = np.repeat(rng.integers(0, 256, (160, 150, 1)).astype(np.uint8), 3, axis=2)  # 24,000 px
    heat = method(name).heat(Frame(rgb), Frame(rgb), np.array([75.5, 81.5], dtype=np.float32))
    assert np.isfinite(heat.values).all()
    best_v, best_u = np.unravel_index(heat.values.argmax(), heat.values.shape)
    assert abs(best_u + 0.5 - 75.5) <= 1
    assert abs(best_v + 0.5 - 81.5) <= 1
    queries = rng.integers(20, 130, (30, 2)) + 0.5
    answers = method(name).answer(Pair(Frame(rgb), Frame(rgb), queries.astype(np.float32)))
    assert (answers.uv_px % 2 == 1.5).all()  # every second row and column


@pytest.mark.parametrize("name", CLASSICAL)
def test_heat_peaks_at_the_answer(name: str) -> None:
    moved = Motion(Similarity(), Similarity(angle_deg=40))
    source, target, query = moved.source, moved.target, moved.queries[:1]
    matcher = method(name)
    assert isinstance(matcher, HeatMatcher)
    assert isinstance(matcher, KeypointMatcher)
    heat = matcher.heat(source, target, query[0])
    v, u = np.unravel_index(np.nanargmax(heat.values), heat.values.shape)
    assert matcher.answer(Pair(source, target, query)).uv_px.tolist() == [[u + 0.5, v + 0.5]]
    np.testing.assert_array_equal(np.isfinite(heat.values), known(target.mask))
    assert 0.1 < heat.confidence <= 1


def test_a_missing_library_of_surf_is_said_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("mahotas", "mahotas.features"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError, match=r"pip install 'pliant\[classical\]'") as caught:
        local_feature("surf")
    assert caught.value.exit_code == 2


def test_every_method_is_documented() -> None:
    page = (Path(__file__).parents[2] / "docs" / "methods-classical.md").read_text("utf-8")
    named = set(re.findall(r"`([a-z0-9-]+)`", page)) | set(re.findall(r"SIFT|SURF|ORB", page))
    assert {name for name in METHODS if not {name, name.upper()} & named} == set()


def test_remembered_frames_change_nothing() -> None:
    poses = [Similarity(angle_deg=angle) for angle in range(0, 70, 10)]
    queries = poses[0].place(CARD_QUERIES).astype(np.float32)
    remembering, forgetting = method("orb"), method("orb")
    for index in (1, 2, 3, 4, 5, 6, 1, 6):  # more frames than are remembered
        source, target = card_view(poses[0], "0"), card_view(poses[index], str(index))
        np.testing.assert_array_equal(
            remembering.answer(Pair(source, target, queries)).uv_px,
            forgetting.answer(Pair(card_view(poses[0]), card_view(poses[index]), queries)).uv_px,
        )


def test_copies_find_what_one_of_them_stored(tmp_path: Path) -> None:
    cache: SharedCache[int] = SharedCache(2, tmp_path)
    assert cache.get("a", lambda: 1) == 1
    copy = pickle.loads(pickle.dumps(cache))
    assert copy.get("a", lambda: 2) == 1
    assert copy.get("", lambda: 3) == 3  # has no name, and is not stored
    assert len(list(tmp_path.iterdir())) == 1
