"""Changed inputs of methods: damaged masks, blank pictures, no masks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from pliant.baselines.conditions import BLANK_VALUE, blank, segmented, with_inputs
from pliant.baselines.controls import Identity
from pliant.baselines.matcher import KeypointMatcher, TrackMatcher
from pliant.spec.answers import Answers
from pliant.spec.frame import Frame, Pair
from tests.known import known


def bar(key: str = "s/0", noise: float = 0.0) -> Frame:
    """A bar of 12 x 400 px with a disc of another object at its left end."""
    rgb = np.full((240, 480, 3), 90.0)
    rgb += np.random.default_rng(0).normal(0, noise, rgb.shape) if noise else 0
    mask = np.zeros((240, 480), bool)
    mask[114:126, 40:440] = True
    rows, columns = np.ogrid[:240, :480]
    objects = mask | ((rows - 120) ** 2 + (columns - 40) ** 2 < 20**2)
    return Frame(rgb.clip(0, 255).astype(np.uint8), mask=mask, key=key, objects=objects)


def test_a_damaged_mask_is_ragged_by_two_pixels() -> None:
    edges = []
    for k in range(20):
        frame = segmented(bar(f"s/{k}"))
        assert frame.mask is not None
        assert not (frame.mask & ~known(frame.objects)).any()
        column = frame.mask[:, 60:380]
        full = column.any(axis=0)
        edges.append(column.argmax(axis=0)[full] - 114.0)
    upper = np.concatenate(edges)
    # Inside and outside distances are whole pixels, and cuts of holes count as contour here.
    assert np.median(upper) == pytest.approx(0, abs=1)
    assert 1.5 < np.percentile(upper, 84) - np.median(upper) < 3.5


def test_holes_and_missing_ends() -> None:
    """Ten of twenty frames lose an end; two holes of 3 to 7 px radius on average."""
    whole = bar()
    assert whole.mask is not None
    cut, share = 0, []
    for k in range(60):
        mask = known(segmented(bar(f"s/{k}")).mask)
        cut += not mask[112:128, 428:436].any() or not mask[112:128, 44:52].any()
        share.append(1 - (mask & whole.mask).sum() / whole.mask.sum())
    assert 15 < cut < 45
    assert 0.02 < np.mean(share) < 0.25


def test_noise_of_the_picture_adds_specks_and_waves() -> None:
    clean, noisy = segmented(bar()), segmented(bar(noise=20.0))
    assert clean.mask is not None
    far = np.ones_like(clean.mask)
    far[100:140] = False
    assert not clean.mask[far].any()
    truth = bar().mask
    assert (known(noisy.mask) != truth).sum() > 1.3 * (clean.mask != truth).sum()


def test_damage_belongs_to_the_frame() -> None:
    a, again, other = segmented(bar("s/1")), segmented(bar("s/1")), segmented(bar("s/2"))
    assert np.array_equal(a.mask, again.mask)  # type: ignore[arg-type]
    assert not np.array_equal(a.mask, other.mask)  # type: ignore[arg-type]
    bare = Frame(bar().rgb)
    assert segmented(bare) is bare
    empty = segmented(bar().replace(mask=np.zeros((240, 480), bool), objects=None))
    assert known(empty.mask).shape == (240, 480)


class Recorder(Identity):
    """Remembers the frames that it is given."""

    def __init__(self) -> None:
        self.seen: list[Frame] = []

    def answer(self, pair: Pair) -> Answers:
        self.seen += [pair.source, pair.target]
        return super().answer(pair)


class Tracker(Recorder):
    def track(self, views: Any, uv_px: Any) -> Iterator[Answers]:
        self.seen += list(views)
        return iter(())


class Keypoints(Recorder):
    def match(self, source: Frame, target: Frame) -> Any:
        self.seen += [source, target]


def test_a_method_is_shown_its_condition() -> None:
    pair = Pair(bar("s/1"), bar("s/2"), np.zeros((1, 2), np.float32))
    inner = Recorder()
    assert with_inputs(inner, "given") is inner
    method = with_inputs(inner, "segmenter", is_blank=True)
    method.answer(pair)
    assert method.describe()["mask_quality"] == "segmenter"
    assert method.describe()["picture"] == "blank"
    for given, seen in zip((pair.source, pair.target), inner.seen, strict=True):
        assert (seen.rgb == BLANK_VALUE).all()
        assert np.array_equal(seen.mask, segmented(given).mask)  # type: ignore[arg-type]
    assert blank(pair.source).mask is pair.source.mask
    assert not isinstance(method, KeypointMatcher)
    assert not isinstance(method, TrackMatcher)
    tracker, keypoints = Tracker(), Keypoints()
    following = with_inputs(tracker, "none")
    assert isinstance(following, TrackMatcher)
    list(following.track([pair.source], pair.uv_a_px))
    own = with_inputs(keypoints, "none")
    assert isinstance(own, KeypointMatcher)
    own.match(pair.source, pair.target)
    assert all(frame.mask is None for frame in (*tracker.seen, *keypoints.seen))
