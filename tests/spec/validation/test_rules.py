"""Single rules, worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from pliant.spec.model import MaterialCoordinate, MaterialObject, Tier
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.colour import MIN_BLOCKS, is_blank, probability
from pliant.spec.validation.rules.tiers import check_tiers
from tests.conformance.base import DIHEDRAL
from tests.dataset_files import coordinate, tier

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


def symmetry_issues(material: list[dict[str, Any]], *maps: tuple[Any, Any]) -> int:
    symmetries = [(f"s{i}", *each) for i, each in enumerate(maps)]
    described = tier("t", "rope", {"x": material}, symmetries)
    findings = Findings()
    check_tiers([Tier.from_document(described)], findings.at("dataset.json"))
    assert set(findings.counts) <= {"SYMMETRY_INVALID"}
    return findings.total


REVERSE = ([[-1, 0], [0, -1]], [1, 0])
MIRROR = ([[1, 0], [0, -1]], [0, 0])
TURN_HALF = ([[1, 0], [0, 1]], [0, 2])


@pytest.mark.parametrize(
    "maps",
    [
        (),
        (REVERSE,),
        (MIRROR,),
        (TURN_HALF,),
        (([[1, 0], [0, -1]], [0, 0.7]),),  # a mirror in any axial plane
        (([[-1, 0], [0, 1]], [1, 0]),),
        (REVERSE, MIRROR, ([[-1, 0], [0, 1]], [1, 0])),
        (([[1, 0], [0, 1]], [0, 1]), TURN_HALF, ([[1, 0], [0, 1]], [0, 3])),
    ],
)
def test_symmetries_of_a_tube(maps: tuple[Any, ...]) -> None:
    assert symmetry_issues([OPEN, CLOSED], *maps) == 0


@pytest.mark.parametrize(
    "maps",
    [
        (([[1, 0], [0, 1]], [0, 4]),),  # the identity, once round
        (([[1, 0], [0, 1]], [0, 1]),),  # a quarter turn alone is no group
        (([[-1, 0], [0, -1]], [0, 0]),),  # leaves the range of s
        (([[-2, 0], [0, 1]], [1, 0]),),
        (([[1, 0.5], [0, 1]], [0, 0]),),  # s would jump at the seam of theta
        (([[0, 1], [1, 0]], [0, 0]),),
    ],
)
def test_what_is_no_symmetry_of_a_tube(maps: tuple[Any, ...]) -> None:
    assert symmetry_issues([OPEN, CLOSED], *maps) > 0


def test_a_helix_may_shift_theta_along_s() -> None:
    screw = ([[-1, 0], [0.5, -1]], [1, -0.25])
    # Twice the map: s comes back; theta gains 0.5 (1 - s) - 0.25 + 0.25 - 0.5 s = 0.5 - s: no.
    assert symmetry_issues([OPEN, CLOSED], screw) > 0
    screw = ([[-1, 0], [0.5, 1]], [1, -0.25])
    # theta + 0.5 s - 0.25, then + 0.5 (1 - s) - 0.25: comes back.
    assert symmetry_issues([OPEN, CLOSED], screw) == 0


def test_the_square_has_eight_symmetries() -> None:
    maps = [(matrix, offset) for _, matrix, offset in DIHEDRAL]
    assert symmetry_issues([OPEN, OPEN], *maps) == 0
    assert symmetry_issues([OPEN, OPEN], *maps[:2]) > 0


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
