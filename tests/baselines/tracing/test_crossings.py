from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.tracing import (
    Nadir,
    Overlap,
    Trace,
    VisibleStrand,
    located,
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
    assert abs(found.directions[0] @ found.directions[1]) < 0.05
    assert self_crossings(line, 250) == []


def test_a_straight_line_and_a_line_on_itself_do_not_cross() -> None:
    there = np.stack([np.linspace(0, 50, 60), np.full(60, 3.0)], axis=1)
    assert self_crossings(there, 5) == []
    assert self_crossings(np.concatenate([there, there[::-1]]), 5) == []


@pytest.mark.parametrize("first_on_top", [True, False])
def test_a_place_near_both_strands_is_on_the_one_that_is_seen_there(first_on_top: bool) -> None:
    line = loop()
    (found,) = self_crossings(line, 10)
    # Along the second strand: seen from 7 px ahead of the crossing on, under the first before.
    square = np.full((48, 48), 20.0, dtype=np.float32)
    square[:, 38:] = -20.0
    seen = VisibleStrand(
        found.place_px, found.directions[1], 12.0, square if first_on_top else -square
    )
    assert seen.first_on_top == first_on_top
    parts = [slice(at - 12, at + 13) for at in (found.first, found.second)]
    known = Overlap(parts[0], parts[1], 6.0, seen)
    target = trace(np.stack([np.arange(STATIONS), np.zeros(STATIONS)], axis=1).astype(float))

    def stations(*overlaps: Overlap) -> np.ndarray:
        # The strands cross at a right angle: the first is 6, 8.5 and 11 px away.
        places = found.place_px + np.outer([6.0, 8.5, 11.0], found.directions[1])
        return placed(target, located(trace(line, *overlaps), places))[:, 0]

    first, second = found.first, found.second
    assert stations() == pytest.approx([second] * 3, abs=10)
    under, past = (first, second) if first_on_top else (second, first)
    assert stations(known) == pytest.approx([under, past, second], abs=10)
