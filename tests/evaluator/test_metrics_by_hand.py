"""Metrics on cases small enough to be worked out on paper."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pliant.evaluator.metrics import pck, surface_images
from pliant.evaluator.metrics.auc import area_under_recall
from pliant.evaluator.metrics.errors import exact_quantiles, rmse_px


def test_the_root_of_the_mean_square_of_some_errors() -> None:
    assert rmse_px(np.array([5.0, 0, 10])) == pytest.approx(math.sqrt(125 / 3))
    assert math.isnan(rmse_px(np.empty(0)))


@pytest.mark.parametrize(("comparison", "level"), [("<=", [0, 0, 1, 2]), ("<", [0, 1, 2, 2])])
def test_a_distance_on_the_threshold_is_within_only_for_less_or_equal(
    comparison: str, level: list[int]
) -> None:
    distance = np.array([0.5, 1.0, 2.0, np.inf])
    found = pck.threshold_level(distance, [1, 2], comparison)
    np.testing.assert_array_equal(found, level)


def test_distance_to_a_silhouette() -> None:
    on = np.zeros((9, 9), bool)
    on[2:7, 2:7] = True
    uv = np.array([[4.5, 4.5], [2.5, 4.5]])
    found = surface_images.silhouette_distance_px(on, uv)
    np.testing.assert_allclose(found, [3, 1])
    assert np.isinf(surface_images.silhouette_distance_px(np.zeros((3, 3), bool), uv)).all()
    filled = surface_images.silhouette_distance_px(np.ones((9, 9), bool), uv)
    np.testing.assert_allclose(filled, [5, 3])
    # An object 10 pixels wide and 3 high in a wide image: exchanged axes give other distances.
    on = np.zeros((8, 20), bool)
    on[1:4, 9:19] = True
    uv = np.array([[12.5, 2.5], [12.5, 1.5], [12.5, 3.5], [9.5, 2.5], [18.5, 2.2]])
    found = surface_images.silhouette_distance_px(on, uv)
    np.testing.assert_allclose(found, [2, 1, 1, 1, np.hypot(1, 0.3)])


def test_quantiles_are_numpys() -> None:
    rng = np.random.default_rng(0)
    levels = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0]
    cases = {
        "spread": rng.exponential(10, 5000),
        "ties": np.round(rng.exponential(3, 5000)),
        "one value": np.full(100, 7.0),
        "single": np.array([3.0]),
        "huge range": np.concatenate([rng.random(1000) * 1e-12, [1e300]]),
        "two values": np.array([0.0] * 999 + [1.0]),
    }
    for name, values in cases.items():
        parts = [values[: len(values) // 3], values[len(values) // 3 :]]
        expected = np.quantile(values, levels)
        found = exact_quantiles(parts, levels)
        np.testing.assert_allclose(np.array(found, float), expected, rtol=1e-14, err_msg=name)
    assert exact_quantiles([np.empty(0)], levels) == [None] * len(levels)


@pytest.mark.parametrize(
    ("errors", "threshold", "area"),
    [
        ([0.0], 1, 1.0),  # recall jumps to 1 at 0
        ([5.0], 1, 0.0),
        ([1.0], 2, 0.75),  # rises to 1 at 1, stays: (0.5 + 1) / 2
        ([1.0, 3.0], 4, (0.25 + 1.5 + 1.0) / 4),
        ([1.0, np.inf], 2, (0.25 + 0.5) / 2),
        ([2.0], 2, 0.0),  # an error equal to the threshold is beyond it
    ],
)
def test_area_under_recall_by_hand(errors: list[float], threshold: float, area: float) -> None:
    assert area_under_recall(np.array(errors), threshold) == pytest.approx(area, abs=1e-12)
    assert np.isnan(area_under_recall(np.array([]), 1))
