"""Where a trace begins and ends: on drawn ropes, whose ends are known."""

import numpy as np
import pytest

from pliant.baselines.tracing import rope_traces
from pliant.baselines.tracing.ends import Ball, from_end_to_end, to_the_edge

HALF_PX = 4.0
BALL = Ball(np.array([50.0, 60.0]), 15.0)


def _rope(first: float, last: float) -> np.ndarray:
    """Return the mask of a level rope whose middle line is v = 60."""
    mask = np.zeros((120, 320), dtype=np.bool_)
    mask[56:64, round(first) : round(last)] = True
    return mask


def _line(first: float, last: float) -> np.ndarray:
    u = np.linspace(first, last, 60)
    return np.stack([u, np.full_like(u, 60.0)], axis=1)


@pytest.mark.parametrize("last", [238.0, 249.0, 258.0])
def test_a_path_ends_at_the_edge_of_the_mask(last: float) -> None:
    path = to_the_edge(_line(80, last), _rope(70, 250), HALF_PX)
    assert path[-1] == pytest.approx([250, 60], abs=3.0 if last > 250 else 0.6)


def test_a_path_stays_where_the_mask_goes_on_for_long() -> None:
    path = _line(80, 200)
    assert np.array_equal(to_the_edge(path, _rope(70, 250), HALF_PX), path)


@pytest.mark.parametrize(
    ("first", "begins"), [*((u, 50 + 0.81 * 15) for u in (52.0, 60.0, 72.0)), (120.0, 120.0)]
)
def test_a_path_near_the_ball_begins_where_the_rope_leaves_it(first: float, begins: float) -> None:
    path = from_end_to_end(_line(first, 245), _rope(64, 250), HALF_PX, BALL)
    assert path[0] == pytest.approx([begins, 60], abs=1e-9)


def test_a_rope_without_a_ball_reaches_both_ends() -> None:
    path = from_end_to_end(_line(80, 240), _rope(70, 250), HALF_PX, None)
    assert path[[0, -1], 0] == pytest.approx([70, 250], abs=0.6)


def test_all_traces_of_a_plain_rope_have_its_length() -> None:
    rows, columns = np.mgrid[:480, :640] + 0.5
    rope = (abs(rows - 240) < 5) & (columns > 110) & (columns < 560)
    ball = np.hypot(rows - 240, columns - 100) < 18
    traces = rope_traces(rope & ~ball, rope | ball)
    found = np.array([[each.uv_px[0, 0], each.uv_px[-1, 0]] for each in traces[:5]])
    assert found[:, 0] == pytest.approx(100 + 0.81 * 18, abs=2.0)
    assert found[:, 1] == pytest.approx(560, abs=2.0)
