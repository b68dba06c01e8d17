"""Places carried from rope to rope: cylinders on a table, and ropes that leave the picture."""

import numpy as np
import pytest

from pliant.baselines.tracing import (
    Nadir,
    Overlap,
    RopeTracer,
    Trace,
    VisibleStrand,
    completed,
    located,
    placed,
)
from pliant.spec.frame import Frame, Pair
from tests.baselines.tracing.test_tracing import arc_places, view_of, wave

FOCAL_PX, HEIGHT_M, RADIUS_M = 700.0, 1.4, 0.011
MIDDLE_PX = np.array([320.0, 240.0])


def projected(points_m: np.ndarray) -> np.ndarray:
    """Return pixels of points (N, 3) seen by a camera straight above the origin, y down."""
    depth = HEIGHT_M - points_m[:, 2]
    return MIDDLE_PX + FOCAL_PX * points_m[:, :2] / depth[:, None]


def rope(start_m: np.ndarray, way: np.ndarray) -> tuple[Trace, np.ndarray, np.ndarray]:
    """Return the trace of a straight rope of 0.4 m, its axis and the vector to its left."""
    axis = np.column_stack([start_m + np.linspace(0, 0.4, 300)[:, None] * way, np.zeros(300)])
    axis[:, 2] = RADIUS_M
    line = projected(axis)
    length_px = float(np.linalg.norm(line[-1] - line[0]))
    half_px = FOCAL_PX * RADIUS_M / (HEIGHT_M - RADIUS_M)
    nadir = Nadir(MIDDLE_PX, FOCAL_PX)
    left = np.array([-way[1], way[0], 0.0])
    return Trace(line, length_px, half_px, 1.0, 0.0, nadir), axis, left


def on_surface(axis: np.ndarray, left: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return points at angles from the highest line of a rope, every 20th station."""
    up = np.array([0.0, 0.0, 1.0])
    normal = np.cos(angle)[:, None] * up + np.sin(angle)[:, None] * left
    return axis[::20] + RADIUS_M * normal


@pytest.mark.parametrize(
    ("start_m", "way"), [((0.45, -0.2), (0.0, 1.0)), ((0.1, 0.3), (-0.8, 0.6))]
)
def test_a_place_keeps_its_angle_around_the_rope(
    start_m: tuple[float, float], way: tuple[float, float]
) -> None:
    source, axis_a, left_a = rope(np.array([-0.45, -0.2]), np.array([0.0, 1.0]))
    target, axis_b, left_b = rope(np.array(start_m), np.array(way))
    angle = np.linspace(-0.7, 0.7, 15)
    uv_a = projected(on_surface(axis_a, left_a, angle))
    uv_b = projected(on_surface(axis_b, left_b, angle))
    found = placed(target, located(source, uv_a))
    assert np.linalg.norm(found - uv_b, axis=1).max() < 0.45
    offset = ((uv_a - source.uv_px[::20]) * source.axes[::20, 1]).sum(axis=1)
    same_offset = target.uv_px[::20] + offset[:, None] * target.axes[::20, 1]
    assert np.linalg.norm(same_offset - uv_b, axis=1).max() > 1.2


def test_places_off_the_body_stay_off_it() -> None:
    source, _, _ = rope(np.array([0.0, -0.2]), np.array([0.0, 1.0]))  # lean 0
    beside = source.uv_px[::50] + 2 * source.half_px * source.axes[::50, 1]
    np.testing.assert_allclose(placed(source, located(source, beside)), beside, atol=1e-6)


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
