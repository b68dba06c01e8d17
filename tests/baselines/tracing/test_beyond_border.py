"""Ropes that leave the picture: a drawn rope, whole and cut off, on both sides of a pair."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.tracing import Nadir, Overlap, RopeTracer, Trace, VisibleStrand, completed
from pliant.spec.frame import Frame, Pair
from tests.baselines.tracing.test_tracing import arc_places, view_of, wave

WHOLE, CUT = wave(), wave(1.5, 50.0)


def cut_at(view: Frame, columns: int) -> Frame:
    """The picture without what is right of a column."""
    rgb, mask, objects = (
        np.ascontiguousarray(each[:, :columns])
        for each in (view.rgb, view.mask, view.objects)
        if each is not None
    )
    return Frame(rgb, mask, objects=objects)


@pytest.mark.parametrize("columns", [300, 250, 180])
def test_places_on_a_rope_that_leaves_the_picture(columns: int) -> None:
    places = np.linspace(0.15, 0.9, 16)
    a, b = arc_places(WHOLE, places), arc_places(CUT, places)
    whole, cut = view_of(WHOLE), cut_at(view_of(CUT), columns)
    shown = b[:, 0] < columns - 4
    assert shown.sum() >= 5
    for one, other, asked, truth in ((whole, cut, a, b), (cut, whole, b, a)):
        pair = Pair(one, other, asked[shown].astype(np.float32))
        gap = RopeTracer().answer(pair).uv_px - truth[shown]
        assert np.linalg.norm(gap, axis=1).max() < 11


@pytest.mark.parametrize("radius_px", [25, 40])
def test_a_rope_that_comes_back_is_joined_outside(radius_px: float) -> None:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 60)
    bend = np.array([270.0, 110.0]) + radius_px * np.column_stack([np.cos(angle), np.sin(angle)])
    x = np.linspace(60, 270, 200)
    upper, lower = (np.column_stack([x, np.full(200, 110 + way * radius_px)]) for way in (-1, 1))
    back = np.concatenate([upper, bend, lower[::-1]])
    places = np.linspace(0.05, 0.95, 31)
    a, b = arc_places(WHOLE, places), arc_places(back, places)
    whole, cut = view_of(WHOLE), cut_at(view_of(back), 272)
    shown = b[:, 0] < 266
    for one, other, asked, truth in ((whole, cut, a, b), (cut, whole, b, a)):
        pair = Pair(one, other, asked[shown].astype(np.float32))
        gap = RopeTracer().answer(pair).uv_px - truth[shown]
        assert np.linalg.norm(gap, axis=1).max() < 15
    said = "The rope leaves the picture of the target and comes back: the way"
    assert RopeTracer().remarks(whole, cut)[-1].startswith(said)


def test_a_user_is_told_that_the_rope_leaves_the_picture() -> None:
    tracer, whole = RopeTracer(), view_of(WHOLE)
    cut = cut_at(view_of(CUT), 250)
    assert tracer.remarks(whole, cut_at(view_of(CUT), 300)) == []  # the rope ends at 284
    said = "The rope leaves the picture of the {}: how much"
    assert tracer.remarks(whole, cut)[-1].startswith(said.format("target"))
    assert tracer.remarks(cut, cut)[-1].startswith(said.format("source and the target"))


def line(length_px: float, **fields: object) -> Trace:
    places = np.column_stack([np.linspace(0, length_px, 201), np.zeros(201)])
    below = Nadir(np.array([160.0, 120.0]), 1e9)
    return Trace(places, length_px, 2.0, 1.0, 0.0, below, **fields)  # type: ignore[arg-type]


@pytest.mark.parametrize("first", [True, False])
def test_a_cut_trace_goes_on_and_keeps_its_overlaps(first: bool) -> None:
    seen = VisibleStrand(np.zeros(2), np.array([1.0, 0.0]), 6.0, np.zeros((4, 4), np.float32))
    overlap = Overlap(slice(20, 40), slice(160, 180), 2.0, seen)
    short = line(100.0, cut=(first, not first), overlaps=(overlap,))
    (same,), (longer,) = completed([line(200.0)], [short])
    assert same.length_px == 200
    assert longer.length_px == pytest.approx(200)
    ends = sorted(longer.uv_px[[0, -1], 0])
    assert ends == pytest.approx([-100, 100] if first else [0, 200])
    for before, after in (
        (overlap.first, longer.overlaps[0].first),
        (overlap.second, longer.overlaps[0].second),
    ):
        for stop in ("start", "stop"):
            place = short.uv_px[min(getattr(before, stop), 200)]
            np.testing.assert_allclose(longer.uv_px[getattr(after, stop)], place, atol=1)


def test_other_traces_stay_as_they_are() -> None:
    whole = line(100.0)
    for short in (line(90.0), line(90.0, cut=(True, True)), line(101.0, cut=(False, True))):
        assert completed([whole], [short]) == ([whole], [short])
    assert completed([], [whole]) == ([], [whole])


@pytest.mark.parametrize("first", [True, False])
def test_of_two_cut_ropes_one_goes_on_only_at_the_end_that_the_other_lacks_too(first: bool) -> None:
    short = line(80.0, cut=(True, False))
    long = line(100.0, cut=(first, not first))
    same, (longer,) = completed([long], [short])
    assert same == [long]
    assert longer.length_px == pytest.approx(100 if first else 80)
