"""Gaps in masks of ropes, cut into curves drawn here."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from pliant.baselines.tracing import rope_traces
from pliant.baselines.tracing.bridging import TableSeen, _bridges, _cost, _End, bridged
from pliant.baselines.tracing.ends import Ball
from pliant.baselines.tracing.mask_shape import (
    depth_in_mask,
    half_width_px,
    shrunk,
    working_factor,
)
from pliant.spec.arrays import BoolArray, FloatArray
from tests.drawn_strands import U, V, drawn

HALF_PX = 6.0
S = np.linspace(0, 1, 2000)
WAVE = np.stack([60 + 520 * S, 240 + 90 * np.sin(2 * np.pi * S)], axis=1)


def costs_of(ends: list[_End]) -> dict[tuple[_End, _End], float]:
    return {pair: _cost(*pair, HALF_PX) for pair in itertools.combinations(ends, 2)}


def made_whole(
    mask: np.ndarray, ball: Ball | None = None, table: TableSeen | None = None
) -> np.ndarray:
    """The mask with its gaps bridged."""
    factor = working_factor(mask)
    small = shrunk(mask, factor)
    half_px = half_width_px(depth_in_mask(small))
    return bridged(mask, small, factor, half_px, ball, table=table)


@pytest.mark.parametrize("width_px", [20, 60])
def test_a_gap_is_bridged_along_the_curve(width_px: int) -> None:
    rope = drawn(WAVE, HALF_PX)
    cover = np.abs(U - 240) < width_px / 2
    whole = made_whole(rope & ~cover)
    assert not (whole & ~cover & ~rope).sum() > 0.01 * rope.sum()
    assert (whole & rope & cover).sum() > 0.5 * (rope & cover).sum()
    traced = rope_traces(rope & ~cover)[0]
    assert traced.length_px == pytest.approx(rope_traces(rope)[0].length_px, rel=0.02)
    far, _ = cKDTree(WAVE).query(traced.uv_px)
    assert far[5:-5].max() < 6
    assert far.max() < HALF_PX + 1  # both ends are round


def test_two_gaps_are_bridged_each_to_its_own_side() -> None:
    rope = drawn(WAVE, HALF_PX)
    cover = (np.abs(U - 250) < 25) | (np.abs(U - 420) < 25)
    whole = made_whole(rope & ~cover)
    assert (whole & rope).sum() > 0.9 * rope.sum()
    assert (whole & ~rope).sum() < 0.04 * rope.sum()


def test_a_mask_without_gaps_comes_back_itself() -> None:
    rope = drawn(WAVE, HALF_PX)
    assert made_whole(rope) is rope


def test_ends_that_do_not_face_each_other_are_left() -> None:
    """Two ropes side by side: joining them would need a turn back."""
    straight = np.stack([100 + 400 * S, np.full_like(S, 200)], axis=1)
    both = drawn(straight, HALF_PX) | drawn(straight + np.array([0, 80]), HALF_PX)
    assert made_whole(both) is both


def test_a_ball_says_that_a_turn_back_is_under_the_cover() -> None:
    """Of two strands side by side, three ends are loose with a ball, and one rope has one."""
    straight = np.stack([100 + 400 * S, np.full_like(S, 200)], axis=1)
    both = drawn(straight, HALF_PX) | drawn(straight + np.array([0, 80]), HALF_PX)
    whole = made_whole(both, Ball(straight[0], 16.0))
    assert ndimage.label(whole)[1] == 1


T = 2 * S - 1
LOOP = np.stack([320 + 416 * (T**3 - 0.6 * T), 110 + 270 * T**2], axis=1)


def test_the_covered_part_of_a_loop_is_bridged_where_a_ball_is_known() -> None:
    """What is seen is one part, connected at the crossing, but three of its ends are loose."""
    rope, cover = drawn(LOOP, HALF_PX), V < 170
    ball = np.hypot(U - LOOP[0, 0], V - LOOP[0, 1]) < 16
    traced = rope_traces(rope & ~cover & ~ball, rope & ~cover | ball)[0]
    far, _ = cKDTree(LOOP).query(traced.uv_px)
    assert far[traced.uv_px[:, 1] > 175].max() < HALF_PX
    turn = np.linalg.norm(traced.uv_px - LOOP[0], axis=1)
    assert turn[0] < 20 < 300 < turn[-1]


def test_the_rest_of_a_rope_at_its_ball_is_bridged_to() -> None:
    """It is so short that both of its ends are at the ball."""
    rope = drawn(WAVE, HALF_PX)
    cover = (U > 78) & (U < 150)
    whole = made_whole(rope & ~cover, Ball(WAVE[0], 16.0))
    assert ndimage.label(whole)[1] == 1
    assert (whole & rope & cover).sum() > 0.4 * (rope & cover).sum()


@pytest.mark.parametrize(("covered", "parts"), [(True, 1), (False, 2)])
def test_a_turn_back_is_not_where_the_table_is_seen(*, covered: bool, parts: int) -> None:
    straight = np.stack([100 + 400 * S, np.full_like(S, 200)], axis=1)
    both = drawn(straight, HALF_PX) | drawn(straight + np.array([0, 160]), HALF_PX)

    def table(uv_px: FloatArray) -> BoolArray:
        assert (uv_px[:, 1] > 190).all()
        assert (uv_px[:, 1] < 370).all()
        return np.full(len(uv_px), not covered)

    whole = made_whole(both, Ball(straight[0], 16.0), table)
    assert ndimage.label(whole)[1] == parts


@pytest.mark.parametrize(("strand", "count"), [(2.0, 0), (20.0, 1)])
def test_spurs_of_a_ragged_edge_are_not_joined_within_their_part(strand: float, count: int) -> None:
    up, right = np.array([0.0, -1.0]), np.array([1.0, 0.0])
    ends = [
        _End(1, np.array([100.0, 100.0]), up, strand=strand),
        _End(1, np.array([140.0, 100.0]), up, strand=strand),
        _End(1, np.array([500.0, 300.0]), right),
    ]
    assert len(_bridges(ends, costs_of(ends), 1)) == count


def test_a_part_is_not_closed_to_a_ring_beside_another_part() -> None:
    """Though its own two ends are the cheapest pair, the other part belongs to the rope too."""
    up = np.array([0.0, -1.0])
    ends = [
        _End(1, np.array([100.0, 100.0]), up),
        _End(1, np.array([140.0, 100.0]), up),
        _End(2, np.array([220.0, 100.0]), up),
    ]
    costs = costs_of(ends)
    assert min(costs, key=costs.__getitem__) == (ends[0], ends[1])
    assert _bridges(ends, costs, 1) == [(ends[1], ends[2])]
    assert _bridges([*ends[:2], replace(ends[2], part=1)], costs_of(ends), 1)


def test_an_end_is_joined_to_the_strand_that_it_points_at() -> None:
    """The mask has a gap next to a crossing. Across the gap is the other strand, not an end."""
    away = np.hypot(U - 320, V - 272)
    cut = drawn(LOOP, HALF_PX) & ~((away > 10) & (away < 26) & (U > 320) & (V < 262))
    for mask, is_closed in [(cut, False), (made_whole(cut, Ball(LOOP[0], 16.0)), True)]:
        table, _ = ndimage.label(~mask)
        assert (table[160, 320] != table[0, 0]) == is_closed


def test_ends_that_face_each_other_are_joined_rather_than_to_strands() -> None:
    """Each of two ends at a narrow gap points at the strand of the other one as well."""
    rope = drawn(WAVE, HALF_PX) & (np.abs(U - 320) > 6)
    ball = Ball(WAVE[0], 16.0)
    assert ndimage.label(made_whole(rope, ball))[1] == 1
    right = np.array([1.0, 0.0])
    ends = [
        _End(1, np.array([300.0, 100.0]), right),
        _End(2, np.array([320.0, 100.0]), -right),
        _End(2, np.array([500.0, 300.0]), right),
    ]
    beside = _End(2, np.array([326.0, 100.0]), None, joint=True)
    costs = costs_of(ends) | {(ends[0], beside): _cost(ends[0], beside, HALF_PX)}
    costs |= {(ends[1], replace(beside, part=1)): costs[ends[0], beside]}
    assert _bridges(ends, costs, 1) == [(ends[0], ends[1])]


def test_a_stub_has_no_direction() -> None:
    """What is seen of the end behind a cover is as wide as long."""
    rope = drawn(WAVE, HALF_PX)
    cover = (U > 430) & ~((U > 566) & (U < 578))
    assert ndimage.label(rope & ~cover)[1] == 2
    whole = made_whole(rope & ~cover, Ball(WAVE[0], 16.0))
    assert ndimage.label(whole)[1] == 1


def test_ends_at_a_narrow_gap_that_is_cut_at_a_slant_face_each_other() -> None:
    """The line between them is across the rope: where it leads says nothing."""
    way = np.array([0.55, 0.835])
    one = _End(1, np.array([326.0, 255.0]), way)
    across = _End(2, np.array([320.0, 255.0]), -way)
    elsewhere = _End(3, one.place + 60 * np.array([0.8, 0.6]), np.array([-0.6, -0.8]))
    assert _cost(one, across, HALF_PX) < _cost(one, elsewhere, HALF_PX)
    # Those of one part really have to face each other: its own short strand is between them.
    assert _cost(one, replace(across, part=1), HALF_PX) > 4


def test_a_ball_that_is_away_is_bridged_to_and_keeps_its_end() -> None:
    """The cover lies between the ball and the rope: the trace begins at the ball."""
    rope = drawn(WAVE, HALF_PX)
    middle = WAVE[0]
    ball = np.hypot(U - middle[0], V - middle[1]) < 16
    cover = U < 150
    mask, objects = rope & ~cover & ~ball, (rope & ~cover) | ball
    whole = made_whole(mask, Ball(middle, 16.0))
    assert (whole & rope & cover).sum() > 0.5 * (rope & cover & ~ball).sum()
    begin = rope_traces(mask, objects)[0].uv_px[0]
    assert np.linalg.norm(begin - middle) < 24


def test_a_mask_of_many_specks_is_not_searched() -> None:
    specks = (U % 16 < 6) & (V % 16 < 6)
    assert made_whole(specks) is specks
