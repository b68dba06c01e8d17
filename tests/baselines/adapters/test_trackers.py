"""Clips given to a tracker, and its tracks as answers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pliant.baselines import Frame, TrackMatcher
from pliant.baselines.adapters import Images, as_matcher, from_tracker
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.frame import Pair
from tests.baselines.cards import Motion
from tests.known import known


@pytest.mark.parametrize("coordinates", ["pixel", "index", "normalised"])
@pytest.mark.parametrize("size", [None, (120, 50)])
def test_rendered_pair_as_a_clip(coordinates: Any, size: Any, motion: Motion) -> None:
    images = Images(size=size, coordinates=coordinates)

    def track(frames: Any, points: Any) -> Any:
        assert frames.shape == (2, *(size or (240, 200))[::-1], 3)
        full = images.from_function(points, motion.source)
        tracks = np.stack([points, images.to_function(motion.move(full), motion.target)])
        return tracks[None], np.stack([np.ones(len(points)), full[:, 0] / 240])[None, ..., None]

    method = from_tracker(track, images=images)
    found = method.answer(motion.pair)
    assert motion.error(found.uv_px).max() < 1e-3
    np.testing.assert_allclose(known(found.visible), motion.queries[:, 0] / 240, atol=1e-6)


def walk(frames: Any, points: Any) -> Any:
    """Move by the brightness of each frame, as far as it is from the first."""
    walked = frames[:, 0, 0, :1].astype(float) - float(frames[0, 0, 0, 0])  # (T, 1)
    return points[None] + np.concatenate([walked, -walked], axis=1)[:, None]


@pytest.mark.parametrize("window", [None, 2, 3, 5, 6, 9])
@pytest.mark.parametrize("batch", [None, 1, 3])
def test_windows_and_batches_change_nothing(window: int | None, batch: int | None) -> None:
    views = [Frame(np.full((8, 9, 3), 10 * number + number**2, np.uint8)) for number in range(6)]
    points = np.random.default_rng(0).uniform(0, 8, (4, 2)).astype(np.float32)
    lengths = []

    def counted(frames: Any, points: Any) -> Any:
        lengths.append(len(frames))
        return walk(frames, points)

    method = from_tracker(counted, window=window, batch=batch)
    assert isinstance(method, TrackMatcher)
    found = [answers.uv_px for answers in method.track(iter(views), points)]
    assert len(found) == 5
    assert max(lengths) == min(window or 6, 6)
    for number, uv_px in enumerate(found, 1):
        by = 10 * number + number**2
        np.testing.assert_allclose(uv_px, points + np.array([by, -by]), atol=1e-3)


def test_frames_are_tensors_on_a_device() -> None:
    torch = pytest.importorskip("torch")

    def stay(frames: Any, points: Any) -> Any:
        assert (frames.shape, frames.dtype) == ((2, 3, 16, 16), torch.float32)
        return torch.from_numpy(points).expand(2, -1, -1)

    view = Frame(np.zeros((9, 9, 3), np.uint8))
    points = np.array([[3, 4]], np.float32)
    found = from_tracker(stay, images=Images(multiple=8, device="cpu")).answer(
        Pair(view, view, points)
    )
    np.testing.assert_allclose(found.uv_px, points, atol=1e-6)


def test_object_with_track_alone_answers_pairs(motion: Motion) -> None:
    class Walker:
        track = from_tracker(walk).track

    found = as_matcher(Walker()).answer(Pair(motion.source, motion.source, motion.queries))  # type: ignore[union-attr]
    np.testing.assert_allclose(found.uv_px, motion.queries)


def test_wrong_shapes_and_settings_are_one_sentence(motion: Motion) -> None:
    for function, message in (
        (
            lambda frames, points: points,
            r"no tracks; found shape \(60, 2\); required: \(2, 60, 2\)",
        ),
        (lambda frames, points: (points,), r"a tuple of another length; found 1; required: one"),
        (lambda frames, points: (walk(frames, points), [1.0]), r"no visibility.*\(2, 60\)"),
        (
            lambda frames, points: (walk(frames, points), np.ones((len(points), len(frames)))),
            r"no visibility.*found shape \(60, 2\); required: \(2, 60\)",
        ),
    ):
        with pytest.raises(SubmissionError, match=message):
            from_tracker(function).answer(motion.pair)
    with pytest.raises(CallError, match=r"window: .*found 1"):
        from_tracker(walk, window=1)
