"""Flow and a matcher put together, on cards whose motion is known."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.baselines import METHODS, Answers, Frame, Pair, TrackMatcher
from pliant.baselines.fused_tracker import FusedTracker
from pliant.spec.arrays import FloatArray
from pliant.spec.errors import CallError, SubmissionError
from tests.baselines.cards import Similarity, card_view
from tests.known import known

pytest.importorskip("cv2")

STEPS = 24
BAR = slice(60, 100)  # columns


class Exact:
    """Knows the poses: answers with a small error, far off in some frames."""

    name = "exact"

    def __init__(self, poses: list[Any], wrong: tuple[int, ...] = ()) -> None:
        self.poses, self.wrong = poses, wrong
        self.asked: list[int] = []

    def describe(self) -> dict[str, Any]:
        return {"name": self.name}

    def answer(self, pair: Pair) -> Answers:
        step = int(pair.target.key)
        self.asked.append(step)
        card = self.poses[0].locate(pair.uv_a_px)
        uv = self.poses[step].place(card).astype(np.float32)
        visible = ~((uv[:, 0] > BAR.start) & (uv[:, 0] < BAR.stop))
        off = uv + np.array([1.5, -1.5], np.float32) if step not in self.wrong else uv[::-1]
        modes = [np.array([[*row, 2.0, 1.0]], np.float32) for row in off]
        return Answers(off, visible.astype(np.float32), modes=modes)


@pytest.fixture
def moving() -> tuple[list[Any], list[Frame]]:
    """A card that slides to the right, behind a bar that stands still."""
    poses = [Similarity(centre=(90 + 2.5 * step, 100)) for step in range(STEPS)]
    bar = np.random.default_rng(5).integers(0, 256, (200, 40, 3)).astype(np.uint8)
    views = []
    for step, each in enumerate(poses):
        rgb = card_view(each).rgb.copy()
        rgb[:, BAR] = bar
        views.append(Frame(rgb, key=str(step)))
    return poses, views


def errors_px(found: Answers, pose: Any, card: FloatArray) -> FloatArray:
    return np.hypot(*(found.uv_px - pose.place(card)).T)


def left_of_bar(pose: Any) -> FloatArray:
    """Points that pass behind the bar, in the card's px."""
    card = np.random.default_rng(1).uniform([-55, -50], [-36, 50], (40, 2))
    assert (pose.place(card)[:, 0] < BAR.start).all()
    return card


def test_a_point_is_found_again_behind_the_bar(moving: tuple[list[Any], list[Frame]]) -> None:
    poses, views = moving
    card = left_of_bar(poses[0])
    start = poses[0].place(card).astype(np.float32)
    matcher = Exact(poses)
    tracker = FusedTracker(matcher, every=4)
    assert isinstance(tracker, TrackMatcher)
    found = list(tracker.track(views, start))
    last = found[-1]
    *_, flow = METHODS["dis-chain"]().track(views, start)  # type: ignore[union-attr]
    behind = poses[-1].place(card)[:, 0] > BAR.stop + 4
    assert behind.sum() > 10
    assert np.median(errors_px(flow, poses[-1], card)[behind]) > 20  # it stays at the bar
    assert np.median(errors_px(last, poses[-1], card)[behind]) < 2.5
    assert matcher.asked == [4, 8, 12, 16, 20]
    for step in (8, 12, 16, 20):
        covered = np.abs(poses[step].place(card)[:, 0] - 80) < 15
        visible = known(found[step - 1].visible)
        assert visible[covered].mean() < 0.2


def test_flow_is_kept_where_it_is_better_and_where_the_matcher_is_wrong(
    moving: tuple[list[Any], list[Frame]],
) -> None:
    poses, views = moving
    card = np.random.default_rng(2).uniform([15, -50], [55, 50], (40, 2))  # never behind the bar
    start = poses[0].place(card).astype(np.float32)
    *_, flow = METHODS["dis-chain"]().track(views, start)  # type: ignore[union-attr]
    for wrong in ((), (8, 16)):
        *_, last = FusedTracker(Exact(poses, wrong), every=8).track(views, start)
        error_px = errors_px(last, poses[-1], card)
        assert np.median(error_px) < max(1.0, np.median(errors_px(flow, poses[-1], card)) + 0.8)
        assert np.quantile(error_px, 0.9) < 3
        assert np.median(known(last.sigma_px)) < 3


def test_opened_by_name() -> None:
    tracker = pliant.open_method("fused:centroid", every=3)
    assert tracker.name == "fused:centroid"
    assert tracker.describe()["every"] == 3
    with pytest.raises(CallError, match="two pictures"):
        pliant.open_method("fused:oracle")
    with pytest.raises(CallError, match="every"):
        pliant.open_method("fused:centroid", every=0)


def test_a_matcher_may_answer_positions_alone(moving: tuple[list[Any], list[Frame]]) -> None:
    poses, views = moving
    start = poses[0].place(left_of_bar(poses[0])).astype(np.float32)

    def track(answer: Callable[[Answers], Any]) -> list[Answers]:
        class Plain(Exact):
            def answer(self, pair: Pair) -> Any:
                return answer(super().answer(pair))

        return list(FusedTracker(Plain(poses), every=4).track(views, start))

    plain, whole = track(lambda found: found.uv_px), track(lambda found: Answers(found.uv_px))
    np.testing.assert_array_equal(plain[-1].uv_px, whole[-1].uv_px)
    with pytest.raises(SubmissionError, match=r"frame 4, uv_px: .*wrong shape; found \(39, 2\)"):
        track(lambda found: found.uv_px[1:])


def test_no_points(moving: tuple[list[Any], list[Frame]]) -> None:
    poses, views = moving
    tracked = list(FusedTracker(Exact(poses)).track(views, np.zeros((0, 2), np.float32)))
    assert [each.uv_px.shape for each in tracked] == [(0, 2)] * (STEPS - 1)
