"""Single rules, worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from pliant.spec.model import MaterialCoordinate, MaterialObject
from pliant.spec.validation.rules.colour import MIN_BLOCKS, is_blank, probability
from tests.dataset_files import coordinate

OPEN, CLOSED = coordinate("a", 0, 1, 2), coordinate("b", -2, 2, 0.5, 4)


def _object(first: dict[str, Any], second: dict[str, Any]) -> MaterialObject:
    return MaterialObject(1, "x", (MaterialCoordinate(**first), MaterialCoordinate(**second)))


def test_material_distance_by_hand() -> None:
    gap = np.array([[0.3, 0.0], [0.0, 1.0], [0.3, 0.8], [0.0, 3.0], [0.0, 2.0], [0.0, -3.9]])
    # 0.3 * 2 m; 1 * 0.5 m; a 3-4-5 triangle of 0.6 and 0.4 … ; 3 is 1 the other way round.
    expected = [0.6, 0.5, np.hypot(0.6, 0.4), 0.5, 1.0, 0.05]
    assert _object(OPEN, CLOSED).distance_m(gap, np.zeros(2)) == pytest.approx(expected)
    assert _object(OPEN, OPEN).distance_m(gap[3:4], np.zeros(2)) == pytest.approx([6.0])


def test_wrap_difference_by_hand() -> None:
    gap = np.array([[3.0, 3.0], [-3.0, -3.0], [0.5, 1.9]])
    assert _object(OPEN, CLOSED).wrapped(gap).tolist() == [[3, -1], [-3, 1], [0.5, 1.9]]


def test_chance_is_that_of_a_t_test_over_blocks() -> None:
    gain = np.random.default_rng(0).normal(0.3, 1.0, MIN_BLOCKS + 5)
    block = np.arange(len(gain)) * 7
    expected = ttest_1samp(gain, 0, alternative="greater").pvalue
    assert probability(gain, block) == pytest.approx(expected)
    # Places of a block that say the same count once.
    assert probability(np.repeat(gain, 3), np.repeat(block, 3)) == pytest.approx(expected)
    assert probability(gain[:MIN_BLOCKS], block[:MIN_BLOCKS]) < 1
    assert probability(gain[1:MIN_BLOCKS], block[1:MIN_BLOCKS]) == 1
    assert probability(gain[:0], block[:0]) == 1


def test_a_picture_of_one_colour_is_blank() -> None:
    rgb = np.full((40, 50, 3), (7, 100, 200), np.uint8)
    assert is_blank(rgb)
    for step, blank in ((2, True), (3, False)):
        one = rgb.copy()
        one[3, 5] += np.uint8(step)  # a pixel between those that are looked at first
        assert is_blank(one) is blank
        one = rgb.copy()
        one[4, 6, 1] -= np.uint8(step)
        assert is_blank(one) is blank
