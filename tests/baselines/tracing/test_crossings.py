from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.tracing import (
    Nadir,
    Overlap,
    Trace,
    located,
    overlap,
    placed,
    self_crossings,
)

STATIONS = 301


def loop(turned_rad: float = 0.0) -> np.ndarray:
    """A curve (t^2, t^3 - t) that crosses itself once, at t = -1 and t = 1, in px."""
    t = np.linspace(-1.4, 1.4, STATIONS)
    curve = 60 * np.stack([t**2, t**3 - t], axis=1)
    c, s = np.cos(turned_rad), np.sin(turned_rad)
    return curve @ np.array([[c, s], [-s, c]]) + 150.0


def trace(line: np.ndarray, *overlaps: Overlap) -> Trace:
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    return Trace(line, length, 6.0, 1.0, 0.0, Nadir.of_image((480, 640)), overlaps)


@pytest.mark.parametrize("turned_rad", [0.0, 1.0, 2.5])
def test_a_loop_crosses_itself_once(turned_rad: float) -> None:
    line = loop(turned_rad)
    (found,) = self_crossings(line, 10)
    assert (found.first, found.second) == pytest.approx((0.4 / 2.8 * 300, 2.4 / 2.8 * 300), abs=1)
    np.testing.assert_allclose(found.place_px, line[43], atol=1.0)
    # The slopes at t = -1 and 1: (-2, 2) and (2, 2), a right angle.
    assert abs(found.ways[0] @ found.ways[1]) < 0.05
    assert self_crossings(line, 250) == []


def test_a_straight_line_and_a_line_on_itself_do_not_cross() -> None:
    there = np.stack([np.linspace(0, 50, 60), np.full(60, 3.0)], axis=1)
    assert self_crossings(there, 5) == []
    assert self_crossings(np.concatenate([there, there[::-1]]), 5) == []


@pytest.mark.parametrize("first_is_upper", [True, False])
def test_a_place_on_both_strands_is_on_the_upper_one(first_is_upper: bool) -> None:
    line = loop()
    (found,) = self_crossings(line, 10)
    known = overlap(
        found, first_is_upper=first_is_upper, half_px=6.0, spacing_px=1.5, stations=STATIONS
    )
    upper, lower = (0, 1) if first_is_upper else (1, 0)
    # On the body of the upper strand, and exactly on the middle of the lower one.
    place = found.place_px + 5.0 * found.ways[lower]
    target = trace(np.stack([np.arange(STATIONS), np.zeros(STATIONS)], axis=1).astype(float))

    def station(*overlaps: Overlap) -> float:
        return float(placed(target, located(trace(line, *overlaps), place[None]))[0, 0])

    passages = (found.first, found.second)
    assert station() == pytest.approx(passages[lower], abs=6)
    assert station(known) == pytest.approx(passages[upper], abs=6)
    # Past the edge of the upper strand, the lower one is visible again.
    place = found.place_px + 9.0 * found.ways[lower]
    assert station(known) == pytest.approx(passages[lower], abs=10)
