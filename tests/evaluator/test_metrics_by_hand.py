"""Metrics on cases small enough to be worked out on paper."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pliant.evaluator.metrics import (
    blocks,
    errors,
    jitter,
    mixtures,
    pck,
    redetection,
    surface_images,
    tapvid,
)
from pliant.evaluator.metrics.errors import exact_quantiles


def test_errors_of_known_triangles() -> None:
    answers = np.array([[3.0, 4.0], [1.0, 1.0], [6.0, 8.0]], np.float32)
    truth = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 0.0]])
    error = errors.endpoint_error_px(answers, truth)
    np.testing.assert_array_equal(error, [5, 0, 10])
    assert errors.rmse_px(error) == pytest.approx(math.sqrt(125 / 3))
    assert math.isnan(errors.rmse_px(error[:0]))
    sums = errors.sum_by_pair(error, np.array([0, 2]))
    np.testing.assert_array_equal(sums, [5, 10])


@pytest.mark.parametrize(("comparison", "level"), [("<=", [0, 0, 1, 2]), ("<", [0, 1, 2, 2])])
def test_a_distance_on_the_threshold_is_within_only_for_less_or_equal(
    comparison: str, level: list[int]
) -> None:
    distance = np.array([0.5, 1.0, 2.0, np.inf])
    found = pck.threshold_level(distance, [1, 2], comparison)
    np.testing.assert_array_equal(found, level)


def test_tapvid_of_four_points() -> None:
    # visible and right; visible but said hidden; visible but far; hidden but said visible.
    found = tapvid.tapvid_pairs(
        scaled_error=np.array([0.5, 0.5, 3.0, 0.1]),
        visible=np.array([True, True, True, False]),
        predicted_visible=np.array([True, False, True, True]),
        right=np.array([True, False, True, False]),
        pair=np.zeros(4, np.int64),
        pairs=1,
        thresholds=[1, 4],
    )
    assert found.occlusion_accuracy[0] == 0.5
    np.testing.assert_allclose(found.points_within[0], [2 / 3, 1])
    # At 1: one true positive; false positives are the far one and the hidden one: 1 / (3 + 2).
    # At 4: two true positives, one false positive: 2 / (3 + 1).
    np.testing.assert_allclose(found.jaccard[0], [1 / 5, 2 / 4])


def test_tapvid_of_a_pair_without_visible_points() -> None:
    hidden = np.array([False])

    def figures(said: np.ndarray, right: np.ndarray) -> tapvid.TapvidPairs:
        return tapvid.tapvid_pairs(
            scaled_error=np.array([1.0]),
            visible=hidden,
            predicted_visible=said,
            right=right,
            pair=np.array([0]),
            pairs=1,
            thresholds=[1],
        )

    quiet = figures(hidden, ~hidden)
    assert quiet.occlusion_accuracy[0] == 1
    assert np.isnan(quiet.points_within).all()
    assert np.isnan(quiet.jaccard).all()
    loud = figures(~hidden, hidden)
    assert loud.jaccard[0, 0] == 0
    for pairs in (quiet, loud):
        assert pairs.columns([1])["tapvid_pair"] == 0
        assert pairs.columns([1])["delta_1_pair"] == 0
    assert quiet.columns([1])["jaccard_pair"] == 0
    assert loud.columns([1])["jaccard_pair"] == 1
    seen = np.array([True])
    one = tapvid.tapvid_pairs(np.zeros(1), seen, seen, seen, np.array([0]), 1, [1])
    assert {name: float(value[0]) for name, value in one.columns([1]).items()} == dict.fromkeys(
        (
            *("oa_pair", "tapvid_pair", "jaccard_pair", "delta_avg_pair", "aj_pair"),
            *("delta_1_pair", "jaccard_1_pair"),
        ),
        1.0,
    )


def test_an_error_is_capped_in_its_direction() -> None:
    answer = np.array([[610.0, 810.0], [610, 810], [13, 14]])
    true = np.full((3, 2), 10.0)
    found = blocks._capped(answer, true, np.array([True, False, True]), 500.0)
    np.testing.assert_allclose(found, [[310, 410], [610, 810], [13, 14]])


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


def single(sigma: float, uv: tuple[float, float] = (0.0, 0.0)) -> mixtures.Mixtures:
    return mixtures.Mixtures(
        np.zeros(1, np.int64), np.array([uv]), np.array([sigma]), np.ones(1), 1
    )


def test_probability_of_a_disc() -> None:
    centred = mixtures.probability_within(single(4.0), np.zeros((1, 2)), 8.0)
    assert centred[0] == pytest.approx(1 - math.exp(-2), rel=1e-12)
    far = mixtures.probability_within(single(1.0), np.array([[50.0, 0.0]]), 8.0)
    assert far[0] == pytest.approx(0, abs=1e-12)
    inside = mixtures.probability_within(single(0.5), np.array([[1.0, 0.0]]), 8.0)
    assert inside[0] == pytest.approx(1, abs=1e-12)
    # A wide Gaussian is flat over the disc: probability is density times area.
    wide = mixtures.probability_within(single(1e4), np.array([[1e4, 0.0]]), 1.0)
    flat = math.exp(-0.5) / (2 * math.pi * 1e8) * math.pi
    assert wide[0] == pytest.approx(flat, rel=1e-6)


def test_the_region_of_one_gaussian_is_a_disc() -> None:
    radius = float(2 * np.sqrt(-2 * np.log1p(-0.5)))
    for factor, inside in ((0.999, True), (1, True), (1.001, False)):
        at = np.array([[radius * factor, 0.0]])
        assert mixtures.in_regions(single(2.0), at, [0.5])[0, 0] == inside


@pytest.mark.parametrize(("modes", "spokes"), [(2, 8), (8, 8), (16, 4), (64, 1), (100, 1)])
def test_points_that_stand_for_a_gaussian(modes: int, spokes: int) -> None:
    """Each ring is at the middle of the probability that it stands for, its points evenly round."""
    edges = np.array([*np.arange(9) / 10, 0.85, 0.89, 0.92, 0.94, 0.96, 0.98, 1])
    points, share = mixtures._sample_pattern(modes)
    inside = 1 - np.exp(-(points**2).sum(axis=1).reshape(15, spokes) / 2)
    np.testing.assert_allclose(inside, np.repeat((edges[1:] + edges[:-1])[:, None] / 2, spokes, 1))
    rings = share.reshape(15, spokes)
    np.testing.assert_allclose(rings, np.repeat(np.diff(edges)[:, None] / spokes, spokes, 1))
    angle = np.arctan2(points[:, 1], points[:, 0]).reshape(15, spokes)
    step = np.mod(np.diff(angle, axis=1), 2 * np.pi)
    np.testing.assert_allclose(step, np.full((15, spokes - 1), 2 * np.pi / spokes))
    turn = np.mod(np.diff(angle[:, 0]), 2 * np.pi)
    golden = np.full(14, np.pi * (3 - math.sqrt(5)))
    between = np.where(np.arange(14) % 2, 2 * np.pi - np.pi / 8, np.pi / 8)
    np.testing.assert_allclose(turn, between if spokes == 8 else golden)


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
        holes = np.insert(values, 0, np.nan)
        parts = [holes[: len(holes) // 3], holes[len(holes) // 3 :]]
        expected = np.quantile(values, levels)
        found = exact_quantiles(parts, levels)
        np.testing.assert_allclose(np.array(found, float), expected, rtol=1e-14, err_msg=name)
    assert exact_quantiles([np.array([np.nan])], levels) == [None] * len(levels)


def test_jitter_is_the_change_between_neighbours_in_time() -> None:
    """Rows out of order; the error hops by 1, 2 and 3 px on one track; then another track."""
    track, frame = np.array([0, 0, 0, 0, 1, 1, 1]), np.array([3, 0, 2, 1, 4, 9, 5])
    error = np.array([[6, 0], [0, 0], [3, 0], [1, 0], [5, 0], [9, 0], [5, 4]], float)
    row, change = jitter.jitter_px(track, frame, error)
    assert dict(zip(row.tolist(), change.tolist(), strict=True)) == {3: 1, 2: 2, 0: 3, 6: 4}


def test_a_region_ends_between_two_points_of_known_density() -> None:
    """Masses in the middle of points at 0.2, 0.55, 0.8, 0.95; log density is linear between."""
    p, mass = np.array([[2.0, 8.0, 1.0, 4.0]]), np.array([[0.3, 0.4, 0.1, 0.2]])
    mass = mass[:, [3, 1, 2, 0]]  # 0.2 at 2, 0.4 at 8, 0.1 at 1, 0.3 at 4
    found = [float(each[0]) for each in mixtures._densities_at(p, mass, (0.2, 0.5, 0.8))]
    assert found == pytest.approx([8, 8 * 2 ** -(0.3 / 0.35), 2])


def test_points_hidden_before_are_those_that_a_hidden_one_of_their_track_precedes() -> None:
    track = np.array([4, 4, 4, 4, 0, 0, 0])
    frames = np.array([3, 1, 2, 5, 1, 2, 3])
    hidden = np.array([False, False, True, True, True, False, False])
    found = redetection.hidden_before(track, frames, hidden)
    np.testing.assert_array_equal(found, [True, False, False, True, False, True, True])
    assert not redetection.hidden_before(track, frames, np.zeros(7, bool)).any()
    found = redetection.hidden_before(
        np.array([1, 1, 2]), np.array([1, 2, 3]), ~np.eye(3, dtype=bool)[1]
    )
    np.testing.assert_array_equal(found, [False, True, False])
