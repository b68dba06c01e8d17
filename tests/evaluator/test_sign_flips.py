"""The paired test: its level, its interval, its agreement with an independent implementation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import permutation_test

from pliant.evaluator.comparison import differences
from pliant.evaluator.scores import Scores
from pliant.evaluator.statistics.crossing import Crossing
from pliant.evaluator.statistics.ratios import Ratio
from pliant.evaluator.statistics.sign_flips import _subsets, paired_difference
from pliant.spec.errors import SpecError

MEAN = Ratio("mean", "lower", "", "", "", "above", "below")
RMSE = Ratio("rmse", "lower", "px", "", "", "above", "below", root=True)


def episodes(count: int) -> Crossing:
    """Pairs that stay within their sequence, one a sequence."""
    codes = np.arange(count)
    return Crossing.of(codes, codes, np.zeros(count, int), 1)


def skewed(rng: np.random.Generator, count: int) -> tuple[Any, Any]:
    """Two methods equal in law, on sequences of unequal size."""
    below = rng.integers(5, 40, count).astype(float)
    above = below * np.exp(rng.normal(3, 1, (1, count)) + rng.normal(0, 1, (2, count)))
    return (above[0], below), (above[1], below)


@pytest.mark.parametrize("count", [6, 8, 11])
def test_interval_excludes_zero_exactly_where_scipy_rejects(count: int) -> None:
    rng = np.random.default_rng(count)
    rejected = 0
    for _ in range(150):
        first, second = skewed(rng, count)
        second = (second[0] * 3.0, second[1])
        found = paired_difference(RMSE, first, second, episodes(count), 0.95)
        # An even number of values on each side, so that two-sided is twice the smaller tail.
        reference = permutation_test(
            (second[0], first[0]), lambda x, y, axis: np.sum(x - y, axis=axis), vectorized=True,
            permutation_type="samples", n_resamples=np.inf, alternative="two-sided",
        )  # fmt: skip
        assert (found.low > 0 or found.high < 0) == (reference.pvalue <= 0.05)
        rejected += reference.pvalue <= 0.05
    assert 5 < rejected < 145


def test_level_holds_for_few_and_for_many_sequences() -> None:
    for count in (6, 20):
        rng = np.random.default_rng(count)
        verdicts = 0
        for _ in range(1000):
            found = paired_difference(RMSE, *skewed(rng, count), episodes(count), 0.95)
            verdicts += found.low > 0 or found.high < 0
        assert 0.01 < verdicts / 1000 < 0.07


def test_subsets_of_many_sequences_form_a_group() -> None:
    for count in (3, 12, 13, 40):
        subsets = _subsets(count).astype(bool)
        members = {row.tobytes() for row in subsets} | {np.zeros(count, bool).tobytes()}
        assert len(members) == len(subsets) + 1 == 2 ** min(count, 12)
        assert subsets.any(axis=0).all()
        rng = np.random.default_rng(0)
        for a, b in rng.integers(0, len(subsets), (50, 2)):
            assert (subsets[a] ^ subsets[b]).tobytes() in members


def test_stated_number_of_sequences_separates_in_four_of_five_cases() -> None:
    rng = np.random.default_rng(0)
    shift, spread = 1.0, 2.0

    def draw(count: int) -> Any:
        effect = rng.normal(shift, spread, count)
        return paired_difference(
            MEAN, (np.zeros(count), np.ones(count)), (effect, np.ones(count)),
            episodes(count), 0.95,
        )  # fmt: skip

    needed = draw(5_000).sequences_needed
    assert needed == pytest.approx((1.96 + 0.8416) ** 2 * spread**2 + 1.92, abs=2)
    found = [draw(needed) for _ in range(400)]
    assert 0.74 < np.mean([item.low > 0 for item in found]) < 0.86
    same = (np.ones(8), np.ones(8))
    assert paired_difference(MEAN, same, same, episodes(8), 0.95).sequences_needed is None


def crossed(rng: np.random.Generator, count: int) -> tuple[Crossing, Any, Any]:
    """Every sequence is the target of four others; a method errs with both sequences of a pair."""
    target = np.repeat(np.arange(count), 4)
    source = np.concatenate(
        [rng.permutation(np.delete(np.arange(count), each))[:4] for each in range(count)]
    )
    crossing = Crossing.of(source, target, np.zeros(4 * count, int), 1)
    effect = np.exp(rng.normal(0, 0.7, (2, count)))
    above = effect[:, crossing.source] * effect[:, crossing.target]
    below = np.ones(len(crossing.source))
    return crossing, (above[0], below), (above[1], below)


@pytest.mark.parametrize("count", [8, 20])
def test_level_of_crossed_pairs(count: int) -> None:
    """By source sequence alone a third of these verdicts would be false."""
    rng = np.random.default_rng(count)
    verdicts = 0
    for _ in range(300):
        crossing, first, second = crossed(rng, count)
        found = paired_difference(RMSE, first, second, crossing, 0.95)
        assert found.sequences == count
        verdicts += found.low > 0 or found.high < 0
    assert verdicts / 300 < 0.06


def test_reports_of_few_sequences_get_no_verdict(scene: Any, tmp_path: Path) -> None:
    scores = []
    for name, offset_px in (("good", 1.0), ("bad", 40.0)):
        table = scene.table(scene.true_px + offset_px)
        scores.append(scene.score(tmp_path, table, name=name, protocol="paper"))
    found = {item.group: item for item in differences(scores, ["rmse_px"])}
    assert found["rope"].verdict == "too few sequences"  # 3 sequences
    assert found["rope"].as_dict()["low"] is None
    assert found["overall"].sequences == 6
    assert found["overall"].verdict == "worse"


def test_a_report_without_a_column_is_refused(scene: Any, tmp_path: Path) -> None:
    whole = scene.score(tmp_path, protocol="paper")
    part = Scores(whole.document, whole.per_pair.drop_columns(["sum_squared_px2"]))
    with pytest.raises(SpecError, match="lacks a column of a metric") as caught:
        differences([whole, part], ["rmse_px"])
    assert "sum_squared_px2" in str(caught.value)
