"""Figures of distributions and of equal partners, on splits made by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from pliant.evaluator.metrics import calibration, distribution, mixtures
from pliant.evaluator.metrics.distribution import (
    Distribution,
    DistributionSettings,
    answered_mixtures,
)
from pliant.evaluator.metrics.mixtures import Mixtures
from pliant.evaluator.metrics.orbit import Orbit, OrbitSettings
from pliant.evaluator.statistics.ratios import Ratio
from tests.evaluator.hand_made import Split, off_by, split

NAN = math.nan
SETTINGS: dict[str, Any] = {
    "sigma_floor_px": 1, "outlier_weight": 0.25, "ece_radius_px": 2, "ece_bins": 4,
    "regions": (0.5,), "sparsification_steps": 2, "recall_radius_px": 4, "recall_min_weight": 0.2,
}  # fmt: skip


def two(weight: tuple[float, float] = (0.5, 0.5), apart_px: float = 100.0) -> Mixtures:
    """Return one answer with two modes of 1 px at (0, 0) and right of it."""
    uv_px = np.array([[0.0, 0], [apart_px, 0]])
    return Mixtures(np.zeros(2, np.int64), uv_px, np.ones(2), np.array(weight), 1)


def made_split(**more: Any) -> Split:
    """Errors of 1, 2 and 3 px of tier x, of 5 px and a missing one of y; sigmas of 0.5 to 8 px."""
    queries = split([3, 1, 2], tiers=["x", "y"], tier=[0, 0, 1])
    answer_px = np.concatenate([off_by(1, 2, 9, 3, 5), [[NAN, NAN]]])
    sigma = np.array([0.5, 2, 2, 8, 4, 0], np.float32)
    return Split(
        queries, answer_px, hidden=[2], cut=2, answers={"sigma_px": sigma}, **more
    )  # fmt: skip


def confidence(sigma: float) -> float:
    """Return the probability of 2 px around the mean."""
    return 1 - math.exp(-2 / sigma**2)


def likelihood(error: float, sigma: float) -> float:
    """Return the floored negative log likelihood, with a quarter of the weight on 1,200 px2."""
    p = math.exp(-(error**2) / (2 * sigma**2)) / (2 * math.pi * sigma**2)
    return -math.log(0.75 * p + 0.25 / 1200)


def test_figures_of_distributions() -> None:
    made = made_split()
    found = made.found(Distribution(DistributionSettings(**SETTINGS), made.context))
    assert made.column("distributions") == [2, 1, 2]
    nll = [
        likelihood(1, 1) + likelihood(2, 2), likelihood(3, 8), likelihood(5, 4) + math.log(4800),
    ]  # fmt: skip
    assert made.column("sum_nll") == pytest.approx(nll)
    # Half of the probability is within 1.177 sigma.
    assert made.column("in_region_50") == [2, 1, 0]
    assert made.column("recalled") == made.column("recallable") == [0, 0, 0]
    sure = [confidence(each) for each in (1, 2, 8, 4)]  # 0.86, 0.39, 0.03, 0.12
    curve = found.curves["overall"]["reliability"]
    assert curve["radius_px"] == 2
    assert curve["count"] == [2, 1, 1]
    assert curve["confidence"] == pytest.approx([(sure[2] + sure[3]) / 2, sure[1], sure[0]])
    assert curve["frequency"] == [0, 1, 1]  # 2 px are within 2 px
    gaps = [sure[2] + sure[3], 1 - sure[1], 1 - sure[0], 1]  # the last: certain and wrong
    assert found.values["overall"]["ece"] == pytest.approx(sum(gaps) / 5)
    assert found.values["x"]["ece"] == pytest.approx((sure[2] + gaps[1] + gaps[2]) / 3)
    assert found.values["y"]["ece"] == pytest.approx((sure[3] + 1) / 2)
    # Squared errors 1, 4, 9, 25 and 2500, the missing one with a sigma of 0: the last removed.
    curve = found.curves["overall"]["sparsification"]
    assert curve["removed"] == [0, 0.5]
    whole = math.sqrt(2539 / 5)
    half = math.sqrt((2500 + 1 + 4 / 2) / 2.5)
    assert curve["rmse_px"] == pytest.approx([whole, half])
    # The best order knows no missing answer: 0, 1, 4, 9, 25, of which 2.5 are left.
    best = [math.sqrt(39 / 5), math.sqrt((0 + 1 + 4 / 2) / 2.5)]
    assert curve["best_rmse_px"] == pytest.approx(best)
    gap = [(whole - best[0]) / whole, (half - best[1]) / whole]
    assert found.values["overall"]["ause"] == pytest.approx(sum(gap) / 2 / 2)
    assert not found.notes


def test_of_many_answers_a_part_is_sorted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distribution, "_MOST_SORTED", 3)
    monkeypatch.setattr(distribution, "_CHUNK_ROWS", 1)
    made = made_split()
    found = made.found(Distribution(DistributionSettings(**SETTINGS), made.context))
    assert found.notes["ause"] == "taken over every 2th answer of the largest groups"
    # Rows 0, 2 (hidden) and 4: sigma 1 and 4, squared errors 1 and 25.
    curve = found.curves["overall"]["sparsification"]
    assert curve["rmse_px"] == pytest.approx([math.sqrt(13), 1])
    x = found.curves["x"]["sparsification"]  # three of tier x are not too many
    assert x["rmse_px"][0] == pytest.approx(math.sqrt(14 / 3))
    assert made.column("sum_nll")[0] == pytest.approx(likelihood(1, 1) + likelihood(2, 2))
    monkeypatch.setattr(distribution, "_MOST_SORTED", 5)
    assert not made.found(Distribution(DistributionSettings(**SETTINGS), made.context)).notes


def test_a_tier_without_counted_answers_has_no_figures_of_distributions() -> None:
    queries = split([1, 1], tiers=["x", "y"], tier=[0, 1])
    made = Split(queries, off_by(1, 1), hidden=[1], answers={"sigma_px": np.ones(2)})
    found = made.found(Distribution(DistributionSettings(**SETTINGS), made.context))
    assert found.values["y"] == {"ece": None, "ause": None}
    assert found.values["x"]["ause"] == 0
    assert "sparsification" not in found.curves["y"]
    assert found.curves["y"]["reliability"]["count"] == []
    plain = Split(queries, off_by(1, 1))
    metric = Distribution(DistributionSettings(**SETTINGS), plain.context)
    assert metric.truth_columns == ()
    found = plain.found(metric)
    assert "distribution" in found.notes
    assert not found.values
    assert "distributions" not in plain.context.table.columns


ORBIT = OrbitSettings(radius_px=4, sigma_floor_px=1)


def test_answers_to_points_with_an_equal_partner() -> None:
    """One case per row: at the point, at a partner, between, lost, discs that touch, …"""
    partners: list[list[tuple[float, float, bool]]] = [
        [(30, 10, True)],  # the answer is 4 px from the point
        [(30, 10, True)],  # the answer is 4 px from the symmetric point
        [(30, 10, True)],  # the answer is 4.1 px from the point
        [(30, 10, True)],  # missing
        [(18, 10, True)],  # the discs touch in one point
        [(18.1, 10, True)],
        [(30, 10, False)],  # no visible partner
        [(30, 10, True), (12, 10, False)],  # a hidden partner may be near, answered there
        [(30, 10, True)],  # hidden point
        [(30, 10, True), (30, 18, True)],  # the discs of two partners touch
        [(NAN, NAN, True)],  # behind the camera
        [(30, 10, True), (10, 25, True)],  # two partners, answered at the first
    ]
    answer_px = off_by(-4, 24, -4.1, NAN, 0, 0, 0, 2, 0, 0, 0, 20)
    answer_px[3] = NAN
    sigma = np.full(12, 0.5)
    queries = split([1] * 12)
    made = Split(queries, answer_px, hidden=[8], partners=partners, answers={"sigma_px": sigma})
    found = made.found(Orbit(ORBIT, made.context))
    assert not found.notes
    assert made.column("orbit_points") == [1, 1, 1, 1, 0, 1, 0, 1, 0, 0, 0, 1]
    assert made.column("orbit_hits") == [1, 1, 0, 0, 0, 1, 0, 1, 0, 0, 0, 1]
    assert made.column("orbit_decided") == [1, 1, 0, 1, 0, 1, 0, 1, 0, 0, 0, 1]
    assert made.column("orbit_flips") == [0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1]
    assert made.column("orbit_distributions") == [1, 1, 1, 1, 0, 1, 0, 1, 0, 0, 0, 1]
    rates = {
        each.name: sum(made.column(each.numerator)) / sum(made.column(each.denominator))
        for each in Orbit.figures(ORBIT)
        if isinstance(each, Ratio)
    }
    masses = {
        f"{name}mass_4px": pytest.approx(sum(made.column(f"orbit_{column}_mass")) / 7)
        for name, column in (("", "own"), ("partner_", "partner"), ("least_", "least"))
    }
    assert rates == {"orbit_pck_4px": 5 / 7, "flip_rate_4px": 3 / 6, **masses}
    # Of the disc of 4 px around a Gaussian of 1 px: all but exp(-8).
    own, partner, least = (
        made.column(f"orbit_{name}_mass") for name in ("own", "partner", "least")
    )
    assert own[5] == pytest.approx(1 - math.exp(-8))
    assert partner[11] == pytest.approx((1 - math.exp(-8)) / 2)
    assert own[3] == partner[3] == least[3] == 0
    assert own[1] == pytest.approx(0, abs=1e-9)
    assert partner[1] == own[0] == pytest.approx(0.4, abs=0.1)  # its centre is on the rim
    assert partner[7] == least[7] == pytest.approx(0, abs=1e-9)
    plain = Split(queries, answer_px, hidden=[8], partners=partners)
    found = plain.found(Orbit(ORBIT, plain.context))
    assert "neither" in found.notes["mass_4px"]
    assert plain.column("orbit_points") == made.column("orbit_points")
    assert "orbit_distributions" not in plain.context.table.columns


def test_distributions_of_some_answers() -> None:
    uv_px = np.arange(10.0).reshape(5, 2)
    chosen = np.array([0, 2])  # of the second pair
    sigma = Split(split([2, 3]), uv_px, answers={"sigma_px": np.array([9.0, 9, 0.2, 9, 3])})
    found = answered_mixtures(sigma.context.answers, sigma.block(1, 2), chosen, 0.5)
    np.testing.assert_array_equal(found.uv_px, [[4, 5], [8, 9]])
    np.testing.assert_array_equal(found.sigma_px, [0.5, 3])
    np.testing.assert_array_equal(found.weight, [1, 1])
    modes = np.array([[1, 2, 0.1, 3], [3, 4, 2, 1], [5, 6, 7, 0.5], [8, 9, 4, 2]], float)
    answers = {
        "modes": modes, "mode_begin": np.array([3, 3, 0, 2, 3]),
        "mode_count": np.array([1, 1, 2, 1, 1]),
    }  # fmt: skip
    several = Split(split([2, 3]), uv_px, answers=answers)
    found = answered_mixtures(several.context.answers, several.block(1, 2), chosen, 0.5)
    np.testing.assert_array_equal(found.row, [0, 0, 1])
    np.testing.assert_array_equal(found.uv_px, [[1, 2], [3, 4], [8, 9]])
    np.testing.assert_array_equal(found.sigma_px, [0.5, 2, 4])
    np.testing.assert_array_equal(found.weight, [0.75, 0.25, 1])
    assert found.rows == 2


def test_bins_of_confidence_take_their_upper_edge() -> None:
    confidence = np.array([0.0, 0.25, 0.26, 0.5, 1.0])
    happened = np.array([True, False, True, True, True])
    table = calibration.reliability_bins(confidence, happened, 4)
    np.testing.assert_allclose(table, [[2, 0.25, 1], [2, 0.76, 2], [0.0, 0, 0], [1.0, 1, 1]])
    used, mean, frequency = calibration.reliability_curve(table)
    np.testing.assert_array_equal(used, [0, 1, 3])
    np.testing.assert_allclose(mean, [0.125, 0.38, 1])
    np.testing.assert_allclose(frequency, [0.5, 1, 1])
    assert calibration.expected_calibration_error(table) == pytest.approx((0.75 + 1.24) / 5)
    assert math.isnan(calibration.expected_calibration_error(np.zeros((2, 3))))


def test_the_area_between_two_sparsification_curves() -> None:
    found = calibration.area_under_sparsification_error(
        np.array([4.0, 4, 2, 2]), np.array([4.0, 2, 2, 1])
    )
    assert found == pytest.approx((0.25 + 0.25 + 0.125) / 4)  # gaps 0, 0.5, 0, 0.25
    # Ties: two of four answers are equally uncertain, of squared errors 4 and 16.
    squared, order_by = np.array([4.0, 1, 16, 0]), np.array([2.0, 1, 2, 3])
    left = calibration.sparsification(squared, order_by, 4)
    np.testing.assert_allclose(left, np.sqrt([21 / 4, 21 / 3, 11 / 2, 1]))


def test_discs_beside_a_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a Gaussian far wider than the disc, of one on its rim, in chunks of one disc."""
    monkeypatch.setattr(mixtures, "_CHUNK_DISCS", 2)
    three = Mixtures(
        np.array([0, 1, 1]), np.array([[3.0, 0], [0, 0], [0, 1e6]]), np.array([2.0, 1, 1]),
        np.array([1, 0.75, 0.25]), 2,
    )  # fmt: skip
    centre = np.array([[0.0, 0], [0, 1]])
    found = mixtures.probability_within(three, centre, 3.0)
    # By sums over a fine grid of the disc.
    step = 0.01
    u, v = np.meshgrid(*[np.arange(-3 + step / 2, 3, step)] * 2)
    inside = u**2 + v**2 <= 9

    def summed(offset: float, sigma: float) -> float:
        density = np.exp(-((u - offset) ** 2 + v**2) / (2 * sigma**2)) / (2 * np.pi * sigma**2)
        return float(density[inside].sum() * step**2)

    expected = [summed(3, 2), 0.75 * summed(1, 1)]
    np.testing.assert_allclose(found, expected, rtol=1e-3)
    # Rounding never gives more than 1.
    beyond = mixtures.probability_within(two((0.5, 0.5 + 1e-9), 0), np.zeros((1, 2)), 50.0)
    assert beyond.tolist() == [1]


@pytest.mark.parametrize(("level", "heights"), [(0.7, (0.06, 0.54)), (0.9, (0.02, 0.18))])
def test_the_region_of_modes_of_different_width(level: float, heights: tuple[float, float]) -> None:
    """Modes of 1 and 3 px, half of the probability each, too far apart to touch.

    A disc up to the share q of a mode's greatest density holds 1 - q of the mode. The wider one is
    nine times lower: q and 9 q, with (1 - q) / 2 + (1 - 9 q) / 2 the level.
    """
    modes = Mixtures(
        np.zeros(2, np.int64), np.array([[0.0, 0], [0, 200]]), np.array([1.0, 3]),
        np.array([0.5, 0.5]), 1,
    )  # fmt: skip
    for v, sigma, height in zip((0, 200), (1, 3), heights, strict=True):
        radius = sigma * math.sqrt(-2 * math.log(height))
        for factor, inside in ((0.95, True), (1.05, False)):
            at = np.array([[radius * factor, v]])
            assert mixtures.in_regions(modes, at, [level])[0, 0] == inside


def test_regions_of_single_gaussians_among_mixtures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows of one, two, one, three and two modes, in chunks of several sizes."""
    rows = Mixtures(
        np.array([0, 1, 1, 2, 3, 3, 3, 4, 4]),
        np.array([[0.0, 0], [0, 0], [99, 0], [5, 5], [0, 0], [50, 0], [0, 50], [7, 0], [7, 90]]),
        np.array([2.0, 1, 1, 1, 1, 1, 1, 1, 1]),
        np.array([1, 0.5, 0.5, 1, 0.4, 0.3, 0.3, 0.5, 0.5]), 5,
    )  # fmt: skip
    for cells in (1 << 20, 2 * 480, 2 * 480 - 1, 1):
        monkeypatch.setattr(mixtures, "_CHUNK_DENSITIES", cells)
        at = np.array([[2.3, 0], [99.5, 0], [5, 6.2], [0, 53.0], [7, 91.5]])
        found = mixtures.in_regions(rows, at, [0.5, 0.95])
        assert found.tolist() == [
            [True, True, False, False, False],
            [True, True, True, False, True],
        ]
    at = np.array([[2.4, 0], [3, 0], [5, 5], [0.5, 0], [7, 0]])
    found = mixtures.in_regions(rows, at, [0.5, 0.99])
    assert found.tolist() == [[False, False, True, True, True], [True] * 5]


def test_modes_of_just_enough_weight_and_distance_count() -> None:
    at = np.array([[[0.0, 16.0], [100.0, -16.0], [100, 16.1]]])
    found = mixtures.modes_near(two((0.95, 0.05)), at, 16, 0.05)
    np.testing.assert_array_equal(found, [[True, True, False]])
    assert mixtures.spread_px(two((0.75, 0.25), 8))[0] == pytest.approx(
        math.sqrt((2 + 0.75 * 4 + 0.25 * 36) / 2)
    )
    doubled = two((1.5, 0.5), 8)  # weights that do not sum to 1
    assert mixtures.spread_px(doubled)[0] == pytest.approx(math.sqrt((2 + 3 + 9) / 2))
