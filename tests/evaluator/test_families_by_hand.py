"""Families of metrics on a split made by hand: every column, curve and note."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from pliant.evaluator.metrics import continuity, pck, surface_images
from pliant.evaluator.metrics.analysis import Analysis, AnalysisSettings
from pliant.evaluator.metrics.auc import Auc, AucSettings, area_under_recall
from pliant.evaluator.metrics.base import NoSettings
from pliant.evaluator.metrics.continuity import Continuity, ContinuitySettings
from pliant.evaluator.metrics.errors import exact_quantiles, rmse_px
from pliant.evaluator.metrics.geodesic import Geodesic, GeodesicSettings
from pliant.evaluator.metrics.localisation import Localisation, LocalisationSettings
from pliant.evaluator.metrics.symmetry import Symmetry
from pliant.evaluator.metrics.tapvid import Tapvid, TapvidSettings
from tests.evaluator.hand_made import Split, episodes, off_by, split

NAN = math.nan
LOST = [[NAN, NAN]]


def test_the_border_belongs_to_the_image() -> None:
    answers = [[0, 0], [40, 30], [-0.1, 5], [40.1, 5], [5, -0.1], [5, 30.1], [39, 31]]
    made = Split(split([2, 1, 1, 1, 2]), answers, hidden=[6])
    made.found(Localisation(LocalisationSettings(quantiles=()), made.context))
    assert made.column("outside_image") == [0, 1, 1, 1, 2]


def test_auc_counts_pairs_that_have_a_visible_point() -> None:
    queries = split([2, 1, 1, 2], tiers=["x", "y"], tier=[0, 0, 1, 1])
    answers = np.concatenate([off_by(1, 3, 0, 1), LOST, off_by(1)])
    made = Split(queries, answers, hidden=[2], cut=2)
    found = made.found(Auc(AucSettings(thresholds_px=(4,)), made.context)).values
    # Mean errors 2, none, 1, inf: recall rises to 1/3 at 1 and 2/3 at 2.
    assert found["overall"]["auc_4px"] == pytest.approx((1 / 6 + 1 / 2 + 4 / 3) / 4)
    # Errors 1, 1, 1, 3, inf.
    assert found["overall"]["auc_4px_queries"] == pytest.approx((0.1 + 1.4 + 0.8) / 4)
    assert found["x"] == {
        "auc_4px": pytest.approx((1 + 2) / 4),
        "auc_4px_queries": pytest.approx((1 / 4 + 3 / 2 + 1) / 4),
    }
    assert found["y"]["auc_4px"] == pytest.approx((1 / 4 + 3 / 2) / 4)
    lone = Split(split([1]), off_by(0), hidden=[0])
    settings = AucSettings(thresholds_px=(4,))
    assert lone.found(Auc(settings, lone.context)).values["overall"]["auc_4px"] is None


def test_the_histogram_of_errors_of_a_small_image_ends_at_its_diagonal() -> None:
    """40x30: 50 px, in steps of 4 px."""
    made = Split(split([4, 1]), off_by(0.3, 49.9, 2, 47.9, 31))
    settings = AnalysisSettings(bin_px=0.5, normalise_by="image_diagonal", bins=5)
    localisation = Localisation(LocalisationSettings(quantiles=()), made.context)
    curve = made.found(Analysis(settings, made.context), localisation).curves["overall"]["error_px"]
    assert curve["edges_px"] == np.arange(0, 52, 4).tolist()
    assert curve["share"] == pytest.approx([0.4, 0, 0, 0, 0, 0, 0, 0.2, 0, 0, 0, 0.2])
    assert curve["share_beyond"] == pytest.approx(0.2)


CONTINUITY = ContinuitySettings(
    queries_per_pair=8, max_distance_a_px=10, min_distance_a_px=1, max_true_stretch=2,
    jump_stretch=4, jump_min_px=8, quantile=0.5,
)  # fmt: skip


def neighbours(a: float, truth: float, answer: float) -> tuple[float, float]:
    """Return how often two queries `a` px apart are asked as neighbours, and how often torn."""
    u_a, true_px, answer_px = (
        np.array([[0, 0], [0, each]], float) for each in (a, truth, answer)
    )  # fmt: skip
    made = Split(split([2]), answer_px, true_px, uv_a_px=u_a)
    made.found(Continuity(CONTINUITY, made.context))
    return made.column("neighbours")[0], made.column("jumps")[0]


@pytest.mark.parametrize(
    ("a", "truth", "answer", "expected"),
    [
        (1.0, 2.0, 8.0, (2, 0)),  # on every edge
        (0.999, 1, 1, (0, 0)),
        (10.0, 20, 40, (2, 0)),
        (10.001, 20, 40, (0, 0)),
        (1.0, 2.001, 1, (0, 0)),
        (1.0, 2.0, 8.001, (2, 2)),
        (10.0, 0.0, 40.001, (2, 2)),
    ],
)
def test_which_neighbours_are_asked_and_torn(
    a: float, truth: float, answer: float, expected: tuple[int, int]
) -> None:
    assert neighbours(a, truth, answer) == expected


def test_neighbours_in_pairs_of_several_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pairs of 3, 2, 1, 3 and 4 queries, of which the first 3 take part; in chunks."""
    u = [0, 1, 3, 0, 9, 5, 4, 2, 0, 0, 8, 5, 0.1]
    uv_px = np.array([[each, 2 * each] for each in u], float)
    usable = np.ones(13, bool)
    usable[8] = False
    starts = np.array([0, 3, 5, 6, 9, 13])
    for cells in (1 << 19, 18, 1):
        monkeypatch.setattr(continuity, "_CHUNK_CELLS", cells)
        row, other = continuity.nearest_neighbours(uv_px, usable, starts, 3)
        assert row.tolist() == [0, 1, 2, 3, 4, 6, 7, 9, 10, 11]
        assert other.tolist() == [1, 0, 1, 4, 3, 7, 6, 11, 11, 10]
    # Queries that differ in one coordinate alone; of two equally near ones the first.
    cross = np.array([[0, 0], [0, 3], [2, 0], [-2, 0]], float)
    row, other = continuity.nearest_neighbours(cross, np.ones(4, bool), np.array([0, 4]), 9)
    assert other.tolist() == [2, 0, 0, 0]
    # One that takes no part is nobody's neighbour, wherever it is.
    line, partly = np.array([[0, 0], [1, 0], [10, 0]], float), np.array([True, True, False])
    row, other = continuity.nearest_neighbours(line, partly, np.array([0, 3]), 9)
    assert (row.tolist(), other.tolist()) == ([0, 1], [1, 0])


TAPVID = TapvidSettings(
    thresholds=(1, 4), comparison="<", scale=(20, 60), visible_threshold=0.5,
    visible_absent="all_visible",
)  # fmt: skip


def test_tapvid_scales_positions_and_reads_what_is_predicted_visible() -> None:
    """40x30 images scaled to 20x60: u by a half, v by two."""
    answer_px = np.array([[16, 12], [10, 12], [12, 10], [NAN, NAN], [10, 10]])
    said = np.array([0.5, 0.49, 0, 0, 0.6], np.float32)
    made = Split(split([2, 3]), answer_px, hidden=[2, 4], answers={"visible": said})
    metric = Tapvid(TAPVID, made.context)
    error, predicted, right = metric.judged(made.block(0, 2))
    np.testing.assert_array_equal(error, [5, 4, 1, np.inf, 0])
    np.testing.assert_array_equal(predicted, [True, False, False, True, True])
    np.testing.assert_array_equal(right, [True, False, True, False, False])
    _, later, _ = metric.judged(made.block(1, 2))
    np.testing.assert_array_equal(later, [False, True, True])
    assert "visible" not in made.found(metric).notes
    assert made.column("oa_pair") == pytest.approx([1 / 2, 1 / 3])
    assert made.column("tapvid_pair") == [1, 1]
    assert made.column("jaccard_pair") == [1, 1]
    silent = Split(split([1]), off_by(2.0))
    metric = Tapvid(TAPVID, silent.context)
    assert metric.judged(silent.block(0, 1))[1].tolist() == [True]
    assert "taken as predicted visible" in silent.found(metric).notes["visible"]
    assert silent.column("delta_1_pair") == [0]  # 1 is not below 1
    assert silent.column("delta_4_pair") == silent.column("jaccard_4_pair") == [1]
    assert silent.column("delta_avg_pair") == silent.column("aj_pair") == [0.5]


def test_geodesic_sums_and_what_is_left_out() -> None:
    """Row 1 is off the object, row 3 missing, rows 4 and 5 have no surface image."""
    known = np.array([True, True, True, True, False, False])
    on_object = np.array([True, False, True, False, False, False])
    metres = np.array([0.5, NAN, 2, 3, NAN, NAN])
    answer_px = np.concatenate([off_by(1, 1, 1), LOST, LOST, off_by(1)])

    def facts(block: object, _: object) -> object:
        part = block.rows  # type: ignore[attr-defined]
        return SimpleNamespace(
            known=known[part], on_object=on_object[part], geodesic_m=metres[part]
        )

    made = Split(split([2, 2, 2]), answer_px, surfaces=SimpleNamespace(facts=facts))
    notes = made.found(Geodesic(GeodesicSettings(search_px=1), made.context)).notes
    assert made.column("geodesic_asked") == [2, 2, 0]
    assert made.column("geodesic_points") == [1, 2, 0]
    assert made.column("off_object") == [1, 1, 0]
    assert made.column("sum_geodesic_m") == [0.5, 5, 0]
    assert made.column("sum_squared_geodesic_m2") == [0.25, 13, 0]
    assert notes["geodesic"].startswith("1 of 3 pairs have no surface image")
    single = Split(split([1, 5]), answer_px, surfaces=SimpleNamespace(facts=facts))
    assert not single.found(Geodesic(GeodesicSettings(search_px=1), single.context)).notes
    known[0] = False
    single = Split(split([1, 5]), answer_px, surfaces=SimpleNamespace(facts=facts))
    notes = single.found(Geodesic(GeodesicSettings(search_px=1), single.context)).notes
    assert notes["geodesic"].startswith("1 of 2 pairs have no surface image")
    hidden = Split(
        split([2, 2, 2]), answer_px, hidden=[0, 4, 5], surfaces=SimpleNamespace(facts=facts)
    )
    assert not hidden.found(Geodesic(GeodesicSettings(search_px=1), hidden.context)).notes


def test_symmetries_of_several_tiers() -> None:
    """Tiers without symmetries, with two and with one; missing answers, one of a hidden point."""
    queries = split([1, 2, 2, 1], tiers=["x", "y", "z"], tier=[0, 1, 2, 2])
    true_px = np.array([[0, 0], [0, 0], [10, 0], [0, 0], [10, 0], [0, 0]], float)
    answer_px = np.array([[3, 0], [10, 0], [0, 0], [9, 0], [NAN, NAN], [NAN, NAN]], float)
    partners = [
        [], [(10, 0, True), (0, 9, True)], [(0, 0, False), (10, 9, True)],
        [(10, 0, True)], [(0, 0, True)], [(10, 0, True)],
    ]  # fmt: skip
    symmetric = SimpleNamespace(symmetries=("half-turn",))
    dataset = episodes(x=SimpleNamespace(symmetries=()), y=symmetric, z=symmetric)
    made = Split(queries, answer_px, true_px, hidden=[5], cut=2, dataset=dataset, partners=partners)
    found = made.found(Symmetry(NoSettings(), made.context))
    assert made.column("symmetric_squared_px2") == [9, 0, 81 + 2500, 0]
    assert made.column("point_symmetric_squared_px2") == [9, 0 + 100, 1 + 2500, 0]
    assert made.column("flipped_pairs") == [0, 1, 1, 0]
    assert made.column("symmetric_pairs") == [0, 1, 1, 0]
    assert made.column("flipped_points") == [0, 1, 2, 0]
    assert made.column("symmetric_points") == [0, 2, 2, 0]
    assert found.notes == {"flip_rate": "tiers without symmetries: x"}


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
