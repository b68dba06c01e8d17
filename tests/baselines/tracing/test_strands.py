"""Paths over all strands of a mask, on curves drawn here."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from scipy.interpolate import make_interp_spline

from pliant.baselines.tracing import Nadir, Trace, rope_traces
from pliant.baselines.tracing.centring import evenly_spaced
from pliant.baselines.tracing.hypotheses import _retraced
from pliant.baselines.tracing.mask_shape import working_factor
from pliant.baselines.tracing.strands import straightest_paths, thinned
from tests.drawn_strands import SIZE, drawn


def winding(turns: float, length_px: float = 560.0, count: int = 3000) -> np.ndarray:
    """A wavy line with a small loop in its middle that lies against it."""
    s = np.linspace(0, 1, count)
    heading = np.interp(s, [0.4, 0.6], [0, 2 * np.pi * turns]) + 0.35 * np.sin(2 * np.pi * s)
    steps = length_px / count * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    line = np.cumsum(steps, axis=0)
    return np.asarray(line - line.min(axis=0) + 40)


def off_px(path: np.ndarray, line: np.ndarray) -> float:
    """Largest distance of two lines at equal shares of their lengths, in the better direction."""
    ways = [evenly_spaced(each, 200)[0] for each in (path, path[::-1], line)]
    return min(float(np.linalg.norm(way - ways[2], axis=1).max()) for way in ways[:2])


@pytest.mark.parametrize("turns", [1.0, -1.0])
@pytest.mark.parametrize("half_px", [1.8, 2.5, 3.2, 5.0])
def test_a_loop_that_lies_against_its_rope_is_passed(turns: float, half_px: float) -> None:
    line = winding(turns)
    mask = drawn(line, half_px)
    first = straightest_paths(mask, half_px, None)[0]
    assert off_px(first, line) < 2 * half_px + 2
    assert off_px(rope_traces(mask)[0].uv_px, line) < half_px + 1.5


def test_crossings_are_passed_straight() -> None:
    """A curve that crosses itself three times: every other way through has sharper turns."""
    t = np.linspace(0.3, 2 * np.pi - 0.3, 4000)
    trefoil = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t)], axis=1)
    line = 60 * trefoil + [320, 240]
    mask = drawn(line, 4.0)
    paths = straightest_paths(mask, 4.0, line[-1])
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    best = evenly_spaced(paths[0], 400)
    assert best[1] == pytest.approx(length, rel=0.06)
    assert np.linalg.norm(best[0][0] - line[-1]) < 10  # it begins where it was told to
    backwards = evenly_spaced(line[::-1], 400)[0]
    assert np.linalg.norm(best[0] - backwards, axis=1).max() < 14
    assert off_px(rope_traces(mask)[0].uv_px, line) < 14


KNOT = """-15 -47, -12 -41, -9 -35, -6 -29, -4 -23, -2 -16, -1 -11, 2 -5, 5 1, 7 6, 8 11, 7 17,
    2 20, -3 18, -3 12, -1 6, 1 0, 3 -6, 4 -12, 1 -17, -4 -18, -8 -14, -8 -8, -7 -2, -4 4, 0 10,
    3 15, 4 22, 5 28, 8 33, 12 38, 16 43"""
"""A figure-eight knot (u, v), pulled tight, of a rope of half width 2."""


@pytest.mark.parametrize("half_px", [1.4, 2.0, 5.0])
def test_a_tight_knot_of_a_thin_rope_is_passed(half_px: float) -> None:
    """Its holes are about a pixel wide, and some crossings are nearer than a strand's width."""
    corners = np.array([place.split() for place in KNOT.split(",")], dtype=np.float64)
    spline = make_interp_spline(np.arange(len(corners)), corners)
    knot = spline(np.linspace(0, len(corners) - 1, 2000)) * half_px / 2
    ways = (knot[0] - knot[20], knot[-1] - knot[-21])
    ends = [np.linspace(knot[k], knot[k] + 5 * ways[k], 500) for k in (0, -1)]
    line = np.concatenate([ends[0][::-1], knot, ends[1]]) + np.array([320, 240])
    paths = straightest_paths(drawn(line, half_px), half_px, None)
    assert off_px(paths[0], line) < 6 * half_px  # nearly as straight as the rope itself
    assert min(off_px(path, line) for path in paths) < 3 * half_px


def test_a_ring_and_what_is_no_rope() -> None:
    t = np.linspace(0, 2 * np.pi, 2000)
    ring = np.stack([320 + 90 * np.cos(t), 240 + 90 * np.sin(t)], axis=1)
    tail = np.stack([np.linspace(410, 560, 500), np.full(500, 240.0)], axis=1)
    found = straightest_paths(drawn(np.concatenate([ring, tail]), 4.0), 4.0, None)
    assert found
    assert evenly_spaced(found[0], 10)[1] == pytest.approx(2 * np.pi * 90 + 150, rel=0.06)
    net = np.zeros(SIZE, np.bool_)
    net[40:440:40, 40:600] = net[40:440, 40:600:40] = True
    assert straightest_paths(net, 1.0, None) == []  # too many strands
    assert straightest_paths(np.zeros(SIZE, np.bool_), 1.0, None) == []


def test_a_skeleton_is_connected_as_its_mask() -> None:
    rng = np.random.default_rng(5)
    eight = np.ones((3, 3))
    for _ in range(20):
        blobs = ndimage.gaussian_filter(rng.normal(size=(80, 100)), 3) > 0.02
        blobs[[0, -1]] = blobs[:, [0, -1]] = False
        parts, _ = ndimage.label(blobs, eight)
        blobs &= np.bincount(parts.ravel())[parts] > 80  # round specks may go
        found = thinned(blobs)
        assert (found <= blobs).all()
        assert ndimage.label(found, eight)[1] == ndimage.label(blobs, eight)[1]
        assert ndimage.label(~found)[1] == ndimage.label(~blobs)[1]  # holes stay holes
        assert ndimage.distance_transform_edt(blobs)[found].mean() > 1  # and it is in the middle
        blocks = found[1:, 1:] & found[:-1, 1:] & found[1:, :-1] & found[:-1, :-1]
        assert blocks.mean() < 0.001  # lines of one pixel


@pytest.mark.parametrize(("half_px", "factor"), [(1.5, 1), (3.2, 1), (5.0, 2), (9.0, 2)])
def test_thin_ropes_are_read_at_a_finer_scale(half_px: float, factor: int) -> None:
    assert working_factor(drawn(winding(0.0), half_px)) == factor


def test_a_kink_bends_more_than_an_arc() -> None:
    def trace(line: np.ndarray) -> Trace:
        places, length = evenly_spaced(line, 600)
        return Trace(places, length, 1.5, 1.0, 0.0, Nadir.of_image(SIZE))

    straight = np.stack([np.linspace(0, 300, 50), np.zeros(50)], axis=1)
    t = np.linspace(0, np.pi / 2, 100)
    arc = 200 * np.stack([np.sin(t), 1 - np.cos(t)], axis=1)
    corner = np.array([[0.0, 0.0], [157.0, 0.0], [157.0, 157.0]])
    assert trace(straight).bend == pytest.approx(0, abs=1e-12)
    # A quarter of a circle of 314 px has 99 to 105 chords of 3 px: n (pi / 2n)^2.
    assert trace(arc).bend == pytest.approx((np.pi / 2) ** 2 / 102, rel=0.05)
    assert trace(corner).bend > 8 * trace(arc).bend
    assert trace(arc).score < trace(straight).score < 1.001


def test_a_loop_that_is_passed_twice_is_retraced() -> None:
    """The stations of one passage are between those of the other."""
    t = np.linspace(-np.pi / 2, 5 * np.pi - np.pi / 2, 5000)
    rings = np.stack([320 + 90 * np.cos(t), 240 + 90 * np.sin(t)], axis=1)
    tails = [np.stack([np.linspace(120, 320, 700), np.full(700, y)], axis=1) for y in (150, 330)]
    once, twice = rings[np.abs(t) < np.pi / 2], rings

    def retraced(round_px: np.ndarray) -> float:
        line = np.concatenate([tails[0], round_px, tails[1][::-1]])
        return _retraced(evenly_spaced(line, 100)[0])

    # In 2.5 rounds every place of the ring is passed twice at least.
    rounds_px, tails_px = 5 * np.pi * 90, 400
    assert retraced(once) == 0
    assert retraced(twice) == pytest.approx(rounds_px / (rounds_px + tails_px), abs=0.04)
