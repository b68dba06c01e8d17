from __future__ import annotations

from collections import Counter
from itertools import takewhile

import numpy as np
import pytest

from pliant.generator.config import QuerySettings
from pliant.generator.seeding import SequenceTask
from pliant.generator.truth.queries import pair_tables
from pliant.generator.truth.query_sampling import (
    FrameTask,
    Tracks,
    draw_points,
    frame_pairs,
    point_classes,
    skip_pairs,
)
from pliant.spec.dataset import Dataset
from tests.generator.runner.standin import make
from tests.known import known

TASK = SequenceTask("rope", "test", 0)
ASKED = ("visible", "surface")
FRAMES = FrameTask(TASK, 0), FrameTask(TASK, 1)


def tracks(states: list[list[str]], boxes: list[list[int] | None]) -> Tracks:
    frames, points = len(states), len(states[0])
    uv = np.arange(frames * points * 2, dtype=np.float32).reshape(frames, points, 2) + 0.25
    return Tracks(uv, np.array(states, object), boxes)


def test_rows_of_a_pair_by_hand():
    # Four points in two frames; points 0, 1 and 3 may be asked; a symmetry reverses them.
    seen = tracks(
        [
            ["visible", "visible", "visible", "self_occluded"],
            ["occluded", "visible", "out_of_frame", "visible"],
        ],
        [[0, 0, 9, 9], [2, 3, 12, 8]],
    )
    partners = np.array([[3], [2], [1], [0]])
    # Point 3 is hidden in frame A: two queries are left.
    chosen = draw_points(np.random.default_rng(0), seen, 0, np.array([0, 1, 3]), 10)
    asked = known(pair_tables(7, *FRAMES, chosen, (seen, seen), partners))
    queries, truth = asked
    assert queries["pair_id"].to_pylist() == truth["pair_id"].to_pylist() == [7, 7]
    assert queries["query_id"].to_pylist() == truth["query_id"].to_pylist() == [0, 1]
    assert (queries["u_a"].to_pylist(), queries["v_a"].to_pylist()) == ([0.25, 2.25], [1.25, 3.25])
    assert truth["point"].to_pylist() == [0, 1]
    assert (truth["u_b"].to_pylist(), truth["v_b"].to_pylist()) == ([8.25, 10.25], [9.25, 11.25])
    assert truth["visibility_b"].to_pylist() == ["occluded", "visible"]
    assert truth["box_px"].to_pylist() == [10.0, 10.0]
    assert truth["alternatives"].to_pylist() == [
        [{"u": 14.25, "v": 15.25, "visibility": "visible"}],
        [{"u": 12.25, "v": 13.25, "visibility": "out_of_frame"}],
    ]


@pytest.mark.parametrize(
    ("states", "boxes"),
    [
        ([["occluded"], ["visible"]], [[0, 0, 1, 1], [0, 0, 1, 1]]),
        ([["visible"], ["occluded"]], [[0, 0, 1, 1], None]),
    ],
)
def test_a_pair_that_cannot_be_asked(states, boxes):
    seen = tracks(states, boxes)
    chosen = draw_points(np.random.default_rng(0), seen, 0, np.array([0]), 3)
    none = np.empty((1, 0), np.int64)
    assert pair_tables(0, *FRAMES, chosen, (seen, seen), none) is None


@pytest.mark.parametrize("frames", [2, 3, 24, 3000])
def test_frame_pairs_of_a_sequence(frames):
    pairs = [
        (source.frame, target.frame)
        for source, target in frame_pairs(np.random.default_rng(1), TASK, [TASK], frames, 8)
    ]
    assert len(set(pairs)) == len(pairs)
    assert all(a != b and min(a, b) >= 0 and max(a, b) < frames for a, b in pairs)
    assert len(pairs) >= min(8, frames * (frames - 1))
    if frames == 3000:  # from frame 0 into each half of the episode, to two neighbours each
        assert all(a == 0 for a, _ in pairs[:4])
        first, second, third, fourth = (b for _, b in pairs[:4])
        assert second == first + 1 <= 1500
        assert 1500 <= third == fourth - 1 < 2999


def test_half_of_the_pairs_spread_over_the_sequence():
    def from_frame_0(seed, frames, wanted):
        pairs = frame_pairs(np.random.default_rng(seed), TASK, [TASK], frames, wanted)
        return [b.frame for a, b in takewhile(lambda pair: pair[0].frame == 0, pairs)]

    spread = [len(from_frame_0(3, 3000, wanted)) for wanted in range(1, 9)]
    assert spread == [0, 2, 2, 2, 2, 4, 4, 4]
    # One stretch of the frames 1 to 3: either two neighbours of it.
    assert {tuple(from_frame_0(seed, 4, 2)[:2]) for seed in range(20)} == {(1, 2), (2, 3)}
    # Stretches of one frame.
    assert {tuple(from_frame_0(seed, 3, 8)[:2]) for seed in range(20)} == {(1, 2)}


@pytest.mark.parametrize(("share", "expected"), [(0.25, (1, 4)), (0.75, (2, 2)), (1.0, (2, 2))])
def test_points_that_move_have_their_share(share, expected):
    # Point 0 moves by a 3-4-5 triangle in frame 2, point 1 by exactly 4 px, which is none; point 2
    # in frame 1; point 3 in frame 3, which is not asked. The others stay.
    uv = np.zeros((4, 8, 2), np.float32)
    uv[2, 0], uv[2, 1], uv[1, 2], uv[3, 3] = (3, 4), (0, 4), (-5, 0), (9, 9)
    seen = Tracks(uv, np.full((4, 8), "visible", object), [None] * 4)
    rng = np.random.default_rng(0)
    drawn = [draw_points(rng, seen, 0, np.arange(8), 4, [1, 2], share) for _ in range(20)]
    for each in drawn:
        moving = len({0, 2} & set(each.tolist()))
        assert len(set(each.tolist())) == len(each) == expected[1]
        assert moving >= expected[0]
    assert len({tuple(each.tolist()) for each in drawn}) > 1


def test_no_target_of_a_skip_is_a_source():
    for seed in range(20):
        pairs = list(skip_pairs(np.random.default_rng(seed), TASK, 10, (1, 3)))
        sources = [source.frame for source, _ in pairs[::2]]
        asked = [(source.frame, target.frame) for source, target in pairs]
        assert asked == [(frame, frame + skip) for frame in sources for skip in (1, 3)]
        targets = {target.frame for _, target in pairs}
        assert len(set(sources)) == len(sources) >= 2
        assert not targets & set(sources)
        # Every other frame that has all its targets would break the rule.
        for frame in set(range(7)) - set(sources):
            assert frame in targets or {frame + 1, frame + 3} & set(sources)


@pytest.mark.parametrize(("frames", "first"), [(1, [0, 1, 2, 3, 0, 1]), (24, [0, 1, 2, 3, 1, 2])])
def test_no_pair_has_source_and_target_of_one_class(frames, first):
    tasks = [SequenceTask("rope", "test", k) for k in range(9)]
    members = tasks if frames == 1 else [TASK]
    places = [FrameTask(tasks[k], 0) if frames == 1 else FrameTask(TASK, k) for k in range(6)]
    assert [each.point_class(frames) for each in places] == first
    pairs = list(frame_pairs(np.random.default_rng(1), members[0], members, frames, 8))
    assert len(pairs) >= 6
    for source, target in pairs:
        assert source.point_class(frames) != target.point_class(frames)


def test_classes_divide_the_material_and_keep_symmetric_points_together():
    partners = np.arange(400)[::-1, None]  # a rope that looks the same from both ends
    one, other = (FrameTask(SequenceTask("rope", "test", k), 0) for k in (0, 1))
    classes = point_classes(5, one, 24, partners)
    assert (classes == classes[::-1]).all()
    assert np.bincount(classes).tolist() == [100] * 4
    assert (classes == point_classes(5, FrameTask(one.task, 7), 24, partners)).all()
    assert (classes != point_classes(5, other, 24, partners)).mean() > 0.5
    # Single frames are paired across sequences, so they share one division.
    assert (point_classes(5, one, 1, partners) == point_classes(5, other, 1, partners)).all()


def test_points_are_drawn_in_random_order():
    seen = tracks([["visible"] * 60], [[0, 0, 9, 9]])
    drawn = [draw_points(np.random.default_rng(k), seen, 0, np.arange(60), 20) for k in range(20)]
    assert all(len(set(each.tolist())) == 20 for each in drawn)
    steps = np.concatenate([np.diff(each) for each in drawn])
    assert 0.35 < (steps > 0).mean() < 0.65


def test_an_episode_asks_the_same_points_in_neighbouring_frames(tiny_episode):
    """Without them no evaluator could tell how an answer trembles."""
    dataset = Dataset.open(tiny_episode)
    queries = dataset.queries("test").to_pylist()
    points = dataset.truth("test")["point"].to_pylist()
    asked: dict[tuple[str, int, int], set[int]] = {}
    for query, point in zip(queries, points, strict=True):
        place = (query["sequence_b"], query["frame_a"], query["frame_b"])
        asked.setdefault(place, set()).add(point)
    follow = [place for place in asked if (*place[:2], place[2] + 1) in asked and place[1] == 0]
    assert follow
    for sequence, a, b in follow:
        assert asked[sequence, a, b] == asked[sequence, a, b + 1]


def test_a_track_asks_frame_0_in_every_later_frame(tmp_path):
    asked = QuerySettings(queries_per_pair=10_000, kind="track")
    make(tmp_path / "set", frames=5, splits={"test": 2}, queries=asked)
    dataset = Dataset.open(tmp_path / "set")
    queries, points = dataset.queries("test"), dataset.truth("test")["point"].to_pylist()
    rows = list(zip(queries.to_pylist(), points, strict=True))
    for sequence in ("rope-test-000000", "rope-test-000001"):
        own = [(query, point) for query, point in rows if query["sequence_b"] == sequence]
        assert {query["sequence_a"] for query, _ in own} == {sequence}
        assert {query["frame_a"] for query, _ in own} == {0}
        followed: dict[int, set[int]] = {frame: set() for frame in range(1, 5)}
        for query, point in own:
            followed[query["frame_b"]].add(point)
        states = dataset.sequence(sequence).correspondences(0)["visibility"].to_pylist()
        kinds = dataset.sequence(sequence).points()["kind"].to_pylist()
        seen = {k for k, pair in enumerate(zip(states, kinds, strict=True)) if pair == ASKED}
        assert followed[1] == seen  # all of them: a track needs no classes
        assert followed[1] == followed[2] == followed[3] == followed[4]


def test_single_frames_are_paired_across_sequences(tmp_path):
    make(tmp_path / "set", frames=1, episodes=False, splits={"val": 1, "test": 3})
    dataset = Dataset.open(tmp_path / "set")
    # One sequence alone makes no pair: the split has no queries, and that is no error.
    assert dataset.splits_with_queries() == ["test"]
    rows = dataset.queries("test").to_pylist()
    pairs = {(row["sequence_a"], row["sequence_b"]) for row in rows}
    assert all(a != b for a, b in pairs)
    assert Counter(b for _, b in pairs) == {f"rope-test-{k:06d}": 2 for k in range(3)}
