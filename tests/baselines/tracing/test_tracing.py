from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.tracing import Nadir, RopeTracer, Trace, located, placed, rope_traces
from pliant.baselines.tracing.mask_shape import depth_in_mask, pixel_links, steps_along
from pliant.baselines.tracing.walk import sampled
from pliant.spec.frame import Frame, Pair
from tests.drawn_strands import drawn

SIZE = (320, 240)
FAR_BELOW = Nadir(np.array([160.0, 120.0]), 1e9)  # a camera without perspective


def painted(
    curve_px: np.ndarray, ball: bool = True, radius: float = 4.0
) -> tuple[np.ndarray, np.ndarray]:
    """The mask of a rope along a curve, and of the rope and a ball at its first point."""
    mask = drawn(curve_px, radius, SIZE[::-1])
    if not ball:
        return mask, mask
    round_it = drawn(curve_px[:1], 2.5 * radius, SIZE[::-1])
    return mask & ~round_it, mask | round_it


def wave(phase: float = 0.0, tilt: float = 0.0) -> np.ndarray:
    """An open curve of 400 points, left to right."""
    t = np.linspace(0, 1, 400)
    return np.column_stack([40 + 240 * t, 120 + 45 * np.sin(7 * t + phase) + tilt * (t - 0.5)])


def loop() -> np.ndarray:
    """A curve that crosses itself once at a right angle."""
    t = np.linspace(-3.8, 3.8, 600)
    return np.column_stack([160 + 28 * t - 62 * np.sin(t), 120 + 55 * np.cos(t)])


def view_of(curve: np.ndarray, ball: bool = True, key: str = "") -> Frame:
    mask, objects = painted(curve, ball)
    return Frame(np.zeros((*mask.shape, 3), np.uint8), mask, key=key, objects=objects)


def arc_places(curve: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Places at shares of a curve's length."""
    passed = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = shares * passed[-1]
    return np.stack([np.interp(at, passed, curve[:, axis]) for axis in (0, 1)], axis=1)


def test_depth_in_a_mask_by_brute_force() -> None:
    rng = np.random.default_rng(0)
    mask = rng.random((14, 17)) > 0.15
    rows, columns = np.nonzero(~mask)
    expected = np.zeros(mask.shape)
    for row, column in np.argwhere(mask):
        expected[row, column] = np.hypot(rows - row, columns - column).min()
    np.testing.assert_allclose(depth_in_mask(mask), np.minimum(expected, 16))


@pytest.mark.parametrize("at", [(0, 0), (7, 9), (20, 28)])
def test_depth_is_that_in_the_whole_picture(at: tuple[int, int]) -> None:
    mask = np.zeros((36, 48), dtype=np.bool_)
    mask[at[0] : at[0] + 16, at[1] : at[1] + 20] = np.random.default_rng(1).random((16, 20)) < 0.9
    rows, columns = np.indices(mask.shape)
    off = np.argwhere(~mask)
    gap_px = np.hypot(rows[..., None] - off[:, 0], columns[..., None] - off[:, 1])
    np.testing.assert_array_equal(depth_in_mask(mask, 48), gap_px.min(axis=-1))


def test_steps_follow_the_mask() -> None:
    """A U: the two tips are near in the image and far along it."""
    mask = np.zeros((6, 5), bool)
    mask[:, 0] = mask[:, 4] = mask[5] = True
    steps = steps_along(mask, pixel_links(np.argwhere(mask)), (0, 0))
    assert steps[0, 4] == 12  # five down, less one for each corner cut; four across; as many up
    assert steps[0, 2] == -1


def test_values_between_pixels() -> None:
    ramp = np.arange(12, dtype=float).reshape(3, 4)
    at = np.array([[0.5, 0.5], [2.0, 1.0], [3.5, 2.5], [-3.1, 0.6], [4.2, 2.5], [1.0, 99.2]])
    np.testing.assert_allclose(sampled(np.pad(ramp, 2), at), [0.0, 3.5, 11.0, 0.0, 3.3, 0.0])


@pytest.mark.parametrize("curve", [wave(), wave(2.0, 60.0), loop()], ids=["wave", "tilted", "loop"])
def test_the_best_trace_is_the_rope(curve: np.ndarray) -> None:
    mask, objects = painted(curve)
    best = rope_traces(mask, objects)[0]
    hidden = 10.0  # by the ball, at the first end
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
    assert best.length_px == pytest.approx(length - hidden, rel=0.06)
    shares = np.linspace(0.1, 0.95, 20)
    truth = arc_places(curve, hidden / length + shares * (1 - hidden / length))
    found = arc_places(best.uv_px, shares)
    assert np.linalg.norm(found - truth, axis=1).max() < 9
    assert best.coverage > 0.95


def test_places_are_carried_to_the_same_arc_length_and_side() -> None:
    source, target = wave(), wave(1.5, 50.0)
    places = np.linspace(0.15, 0.95, 12)
    a, b = arc_places(source, places), arc_places(target, places)
    answers = (
        RopeTracer().answer(Pair(view_of(source), view_of(target), a.astype(np.float32))).uv_px
    )
    assert np.linalg.norm(answers - b, axis=1).max() < 9
    above = (a - np.array([0, 3])).astype(np.float32)
    moved = RopeTracer().answer(Pair(view_of(source), view_of(target), above)).uv_px
    assert (moved - answers)[:, 1].mean() < -1  # on slopes the offset is partly along the rope


def test_a_rope_without_ball_is_traced_from_either_end() -> None:
    """Which end is the first cannot be known: one of the two readings is right."""
    source, target = wave(), wave(1.5, 50.0)
    places = np.linspace(0.1, 0.9, 12)
    a = arc_places(source, places).astype(np.float32)
    answers = RopeTracer().answer(Pair(view_of(source, False), view_of(target, False), a)).uv_px
    errors = [
        np.linalg.norm(answers - arc_places(target, shares), axis=1).max()
        for shares in (places, 1 - places)
    ]
    assert min(errors) < 9


def test_places_on_a_reading_from_the_other_end_change_sides() -> None:
    line = np.column_stack([np.linspace(0, 99, 300), np.zeros(300)])
    one, other = (Trace(way, 99.0, 3.0, 1.0, 0.0, FAR_BELOW) for way in (line, line[::-1]))
    place = placed(other, located(one, np.array([[20.0, 2.0]])))
    np.testing.assert_allclose(place, [[79.0, -2.0]], atol=0.5)


def test_places_between_stations_and_beyond_the_ends_stay_where_they_are() -> None:
    angle = np.linspace(0, 2, 60)
    arc = np.stack([200 * np.cos(angle), 200 * np.sin(angle)], axis=1)
    one = Trace(arc, 400.0, 3.0, 1.0, 0.0, FAR_BELOW)
    places = np.concatenate([(arc[:-1] + arc[1:]) / 2, arc[-1:] * 1.02 + [-2.0, -1.0]])
    np.testing.assert_allclose(placed(one, located(one, places)), places, atol=1e-9)


def test_no_mask_and_specks_give_the_middle() -> None:
    blank = Frame(np.zeros((240, 320, 3), np.uint8))
    speck = view_of(np.array([[100.0, 100.0]]), ball=False)
    queries = np.zeros((2, 2), np.float32)
    answers = RopeTracer().answer(Pair(blank, speck, queries)).uv_px
    np.testing.assert_allclose(answers, [[100, 100]] * 2, atol=1)
