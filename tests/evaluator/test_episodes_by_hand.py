"""Families of metrics on episodes made by hand: time, jitter, videos, points seen again; slices."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pliant.evaluator.metrics.base import Metric, NoSettings
from pliant.evaluator.metrics.jitter import Jitter, _clips
from pliant.evaluator.metrics.redetection import Redetection
from pliant.evaluator.metrics.tapvid import TapvidSettings
from pliant.evaluator.metrics.time import Time, TimeSettings
from pliant.evaluator.metrics.videos import Videos, VideosSettings
from tests.evaluator.hand_made import Split, episodes, off_by, split

NAN = math.nan


def named(**temporal: bool) -> Any:
    """Return a dataset of sequences that are episodes or not."""
    return SimpleNamespace(
        sequence=lambda name: SimpleNamespace(temporal=temporal[name], shape=None), tiers={}
    )


def test_the_error_by_the_frames_since_the_query() -> None:
    """Forwards, backwards, at once, between two episodes, and in no episode."""
    queries = split(
        [2, 1, 1, 1, 1, 1], tiers=["x", "y"], tier=[0, 0, 0, 0, 1, 0], sequences=["s", "r", "q"],
        sequence_a=[0, 0, 0, 0, 2, 1], sequence_b=[0, 0, 0, 1, 2, 1],
        frame_a=[0, 3, 2, 0, 0, 0], frame_b=[1, 1, 2, 1, 1, 3],
    )  # fmt: skip
    dataset = named(s=True, r=True, q=False)
    made = Split(queries, off_by(3, 9, 4, 1, 1, 1, 2), hidden=[1], cut=3, dataset=dataset)
    found = made.found(Time(TimeSettings(frames=(1, 3)), made.context))
    assert made.column("time_squared_px2") == [9, 16, 1, 1, 1, 4]
    assert made.column("time_counted") == [1, 1, 1, 1, 1, 1]
    assert made.column("time_squared_px2_1") == [9, 0, 0, 0, 0, 0]
    assert made.column("time_counted_1") == [1, 0, 0, 0, 0, 0]
    assert made.column("time_squared_px2_3") == [0, 0, 0, 0, 0, 4]
    assert made.column("time_counted_3") == [0, 0, 0, 0, 0, 1]
    curve = {"frames": [1, 2, 3], "rmse_px": [3, 4, 2], "queries": [1, 1, 1]}
    assert found.curves == {"overall": {"rmse_over_time": curve}, "x": {"rmse_over_time": curve}}
    assert not found.notes
    near = Split(split([1, 2]), off_by(1, 3, 4))
    found = near.found(Time(TimeSettings(frames=(1,)), near.context))
    curve = found.curves["overall"]["rmse_over_time"]
    assert curve["rmse_px"] == pytest.approx([math.sqrt(26 / 3)])
    assert curve["queries"] == [3]


def test_clips_have_one_source_frame_and_consecutive_target_frames() -> None:
    queries = split(
        [1] * 9, sequences=["s", "r", "q"], sequence_a=[0, 0, 0, 0, 0, 0, 1, 0, 0],
        frame_a=[0, 0, 0, 1, 0, 0, 0, 0, 0], sequence_b=[1, 1, 1, 1, 2, 1, 1, 2, 0],
        frame_b=[1, 2, 4, 3, 1, 5, 3, 2, 3],
    )  # fmt: skip
    dataset = named(s=True, r=True, q=False)
    context = Split(queries, np.zeros((9, 2)), dataset=dataset).context
    clip = _clips(context)
    alone = [3, 4, 6, 7, 8]
    assert clip[alone].tolist() == [-1] * 5
    assert np.delete(clip, alone).tolist() == [clip[0]] * 4
    assert clip[0] >= 0


def test_jitter_is_summed_in_the_later_pair() -> None:
    """Point 7 hops by (3, 4), point 8 is hidden once, point 9 is not answered in frame 2."""
    queries = split([3, 3, 3, 1], frame_b=[1, 2, 3, 9])
    true_px = np.tile([20.0, 10], (10, 1))
    answer_px = true_px.copy()
    answer_px[[3, 6]] += [[3, 4], [3, 4]]
    answer_px[5] = NAN
    point = np.array([7, 8, 9, 7, 8, 9, 7, 8, 9, 7])
    made = Split(queries, answer_px, true_px, hidden=[4], cut=2, point=point)
    assert not made.found(Jitter(NoSettings(), made.context)).notes
    # Frame 2: 5 px of point 7, and twice the diagonal of 50 px; frame 3: 0 and the same again.
    assert made.column("sum_jitter_px") == [0, 105, 100, 0]
    assert made.column("jitter_steps") == [0, 2, 2, 0]


TAPVID = TapvidSettings(
    thresholds=(1, 4), comparison="<", scale=(40, 30), visible_threshold=0.5,
    visible_absent="all_visible",
)  # fmt: skip


@pytest.mark.parametrize("mode", ["first", "strided"])
def test_videos_sum_the_counts_of_their_evaluated_pairs(mode: Any) -> None:
    """Two videos, one target frame before the query's, one at it, and a pair of two videos."""
    queries = split(
        [2, 1, 1, 1, 1, 1], sequences=["s", "r"], sequence_a=[0, 0, 0, 0, 1, 1],
        sequence_b=[0, 0, 0, 0, 1, 0], frame_a=[0, 0, 2, 2, 0, 0], frame_b=[1, 2, 2, 1, 1, 1],
    )  # fmt: skip
    errors = np.array([0, 2, 5, 0, 9, 0, 0.0])
    made = Split(queries, off_by(*errors), cut=3)
    settings = VideosSettings(tapvid=TAPVID, query_mode=mode)
    notes = made.found(Videos(settings, made.context)).notes
    assert set(notes) == {"visible"}
    assert made.column("video") == [1, 0, 0, 0, 1, 0]
    of_first = [0, 2, 5, 9] if mode == "strided" else [0, 2, 5]
    within = [sum(each < t for each in of_first) / len(of_first) for t in (1, 4)]
    assert made.column("delta_1_pair") == pytest.approx([within[0], 0, 0, 0, 1, 0])
    assert made.column("delta_4_pair") == pytest.approx([within[1], 0, 0, 0, 1, 0])
    assert made.column("delta_avg_pair") == pytest.approx([sum(within) / 2, 0, 0, 0, 1, 0])
    assert made.column("oa_pair") == [1, 0, 0, 0, 1, 0]


def test_points_that_were_hidden_before() -> None:
    """Point 7 is hidden in frame 2, point 8 in frame 4; point 7 of another source frame is not.

    In frame 3 point 7 is within 1 px, in frame 4 within 4 px. From frame 2 backwards it is hidden,
    which is another track than forwards.
    """
    queries = split(
        [2, 2, 2, 2, 1, 1], frame_a=[1, 1, 1, 1, 2, 2], frame_b=[4, 2, 3, 5, 3, 1],
        sequences=["s", "r"], sequence_b=[0, 0, 0, 1, 0, 0],
    )  # fmt: skip
    answer_px = off_by(2, 0, 0, 0, 0.5, 0, 0, 0, 0, 0)
    point = np.array([7, 8, 7, 8, 7, 8, 7, 8, 7, 7])
    made = Split(queries, answer_px, hidden=[1, 2, 9], cut=2, point=point)
    assert not made.found(Redetection(TAPVID, made.context)).notes
    assert made.column("redetected_jaccard_pair") == [1, 0, 1, 0, 0, 0]
    # Frame 4 within 4 px alone; frame 3 within both thresholds.
    assert made.column("redetected_aj_pair") == [0.5, 0, 1, 0, 0, 0]
    never = Split(queries, answer_px, cut=2, point=point)
    notes = never.found(Redetection(TAPVID, never.context)).notes
    assert notes["aj_redetected"] == "no point is queried after it was hidden"
    assert never.column("redetected_jaccard_pair") == [0] * 6


@pytest.mark.parametrize(
    ("family", "settings", "name", "said"),
    [
        (Time, TimeSettings(frames=(1,)), "rmse_over_time", "no pair is in one episode"),
        (Jitter, NoSettings(), "jitter_px",
         "no point is queried in consecutive frames of an episode"),
        (Videos, VideosSettings(tapvid=TAPVID, query_mode="first"), "videos",
         "no pair is evaluated: a video is an episode"),
        (Redetection, TAPVID, "aj_redetected", "no point is queried in an episode"),
    ],
)  # fmt: skip
def test_a_family_says_why_it_has_no_figure(
    family: type[Metric[Any]], settings: Any, name: str, said: str
) -> None:
    """Two independent configurations, and frame 0 of an episode asked in itself."""
    point = np.array([7, 7])
    apart = Split(split([1, 1]), off_by(1, 2), point=point, dataset=episodes(temporal=False))
    assert apart.found(family(settings, apart.context)).notes[name] == said
    if family is not Redetection:
        still = Split(split([1, 1], frame_b=[0, 0]), off_by(1, 2), point=point)
        assert still.found(family(settings, still.context)).notes[name] == said
