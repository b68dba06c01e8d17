"""Which frames a `TrackMatcher` is shown, and whose answer goes where."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.baselines.matcher import TrackMatcher
from pliant.baselines.predict import predict
from pliant.baselines.tracks import answer_tracks, tasks_by_source
from pliant.spec.answers import Answers
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SubmissionError
from pliant.spec.frame import Frame, Pair
from pliant.spec.io.parquet import read_table
from pliant.spec.queries import QueryPair
from tests.known import known


class Counter:
    """Answers with the number of the frame it is shown, and remembers what it was shown."""

    name = "counter"

    def __init__(self) -> None:
        self.shown: list[list[int]] = []
        self.points: list[list[list[float]]] = []

    def describe(self) -> Mapping[str, Any]:
        return {}

    def answer(self, pair: Pair) -> Answers:
        nowhere = np.full((len(pair.uv_a_px), 2), -1, dtype=np.float32)
        return Answers(nowhere, visible=np.zeros(len(pair.uv_a_px), dtype=np.float32))

    def track(self, views: Iterable[Frame], uv_px: Any) -> Iterator[Answers]:
        frames = iter(views)
        self.points.append(uv_px.tolist())
        self.shown.append([int(next(frames).key.split("/")[1])])
        for view in frames:
            number = int(view.key.split("/")[1])
            self.shown[-1].append(number)
            at = np.stack([uv_px[:, 0], np.full(len(uv_px), number)], axis=1)
            yield Answers(at.astype(np.float32), visible=uv_px[:, 0] / 1024)


AskPair = Callable[..., QueryPair]


@pytest.fixture
def pair(tiny_episode: Path) -> AskPair:
    episode = Dataset.open(tiny_episode)["rope-test-000000"]

    def make(number: int, a: int, b: int, u: float = 1.0) -> QueryPair:
        return QueryPair(episode[a], episode[b], np.array([[u, 2.0]], dtype=np.float32), number)

    return make


def test_forward_and_backward_are_two_tracks_of_every_frame_between(pair: AskPair) -> None:
    matcher = Counter()
    asked = [pair(0, 3, 6), pair(1, 3, 1), pair(2, 3, 4), pair(3, 3, 3)]
    results = answer_tracks(matcher, asked)
    assert matcher.shown == [[3, 4, 5, 6], [3, 2, 1]]
    assert [float(answers.uv_px[0, 1]) for answers, _ in results] == [6, 1, 4, 2]
    assert all(masked for _, masked in results)


def test_points_of_all_pairs_are_one_track(pair: AskPair) -> None:
    """Each pair gets the answers of its own points, in its own order."""
    episode = pair(0, 0, 1).source.sequence
    asked = [
        QueryPair(episode[0], episode[2], np.array([[1, 2], [3, 4]], dtype=np.float32), 0),
        QueryPair(episode[0], episode[1], np.array([[3, 4], [7, 2]], dtype=np.float32), 1),
    ]
    matcher = Counter()
    results = answer_tracks(matcher, asked)
    assert matcher.shown == [[0, 1, 2]]
    assert matcher.points == [[[1, 2], [3, 4], [7, 2]]]
    assert results[0][0].uv_px.tolist() == [[1, 2], [3, 2]]
    assert results[1][0].uv_px.tolist() == [[3, 1], [7, 1]]
    assert known(results[1][0].visible).tolist() == [3 / 1024, 7 / 1024]


def test_a_track_with_missing_answers_is_refused(pair: AskPair) -> None:
    class Forgetful(Counter):
        def track(self, views: Iterable[Frame], uv_px: Any) -> Iterator[Answers]:
            return super().track(views, uv_px[:-1])

    with pytest.raises(SubmissionError, match=r"frame rope-test-000000/.*found \(0, 2\)"):
        answer_tracks(Forgetful(), [pair(0, 0, 2)])


def test_a_track_that_is_none_is_refused(pair: AskPair, cards: Dataset) -> None:
    class Without(Counter):
        def track(self, views: Iterable[Frame], uv_px: Any) -> Any:
            return None

    class Alone:
        track = Without.track

    with pytest.raises(SubmissionError, match="'counter' tracked no frames; found NoneType"):
        answer_tracks(Without(), [pair(0, 0, 2)])
    with pytest.raises(SubmissionError, match="something else than answers; found NoneType"):
        pliant.predict(cards, Alone())  # type: ignore[arg-type]


@pytest.mark.parametrize(("left_out", "found"), [(2, "1"), (0, "more")])
def test_a_track_of_other_frames_is_refused(pair: AskPair, left_out: int, found: str) -> None:
    """One stops a frame early; one also answers the frame that the points are in."""

    class Wrong(Counter):
        def track(self, views: Iterable[Frame], uv_px: Any) -> Iterator[Answers]:
            for _ in list(views)[left_out:]:
                yield Answers(uv_px)

    with pytest.raises(SubmissionError, match=f"found answers for {found}; required: 2"):
        answer_tracks(Wrong(), [pair(0, 0, 2)])


def test_a_tracker_without_answers_for_two_images_is_refused(cards: Dataset) -> None:
    class Silent:
        def track(self, views: Iterable[Frame], uv_px: Any) -> Iterator[Answers]:
            return iter(())

    with pytest.raises(SubmissionError, match="'Silent' returned something else than answers"):
        pliant.predict(cards, Silent())  # type: ignore[arg-type]


def test_tasks_keep_the_order_and_part_at_every_new_source(pair: AskPair) -> None:
    asked = [pair(0, 0, 1), pair(1, 0, 5), pair(2, 4, 2), pair(3, 0, 3)]
    assert [[p.pair_id for p in task] for task in tasks_by_source(asked)] == [[0, 1], [2], [3]]


def test_a_split_of_episodes_is_tracked(tiny_episode: Path, tmp_path: Path) -> None:
    dataset, matcher = Dataset.open(tiny_episode), Counter()
    assert isinstance(matcher, TrackMatcher)
    path = tmp_path / "sub.parquet"
    prediction = predict(dataset, "test", matcher, path)
    assert prediction.method["mask"] == "given"
    frame_of = {p.pair_id: p.target.index for p in dataset.pairs("test")}
    table = read_table(path, "answers")
    for number, v in zip(table["pair_id"].to_pylist(), table["v"].to_pylist(), strict=True):
        assert v == frame_of[number]


def test_configurations_are_answered_pair_by_pair(tiny_dataset: Path, tmp_path: Path) -> None:
    path, matcher = tmp_path / "sub.parquet", Counter()
    predict(Dataset.open(tiny_dataset), "test", matcher, path)
    assert not matcher.shown
    assert set(read_table(path, "answers")["u"].to_pylist()) == {-1}
