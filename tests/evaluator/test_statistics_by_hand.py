"""Ratios, crossings, bootstrap and sign flips against loops over pairs, sequences and subsets."""

from __future__ import annotations

import itertools
import math
from statistics import NormalDist

import numpy as np
import pytest
from scipy import stats

from pliant.evaluator.statistics import bootstrap, crossing
from pliant.evaluator.statistics.bootstrap import Bootstrap, interval, intervals, replicates
from pliant.evaluator.statistics.crossing import Crossing
from pliant.evaluator.statistics.ratios import Ratio
from pliant.evaluator.statistics.sign_flips import fewest_sequences, paired_difference
from pliant.spec.errors import CallError

SETTINGS = Bootstrap(unit="sequences", replicates=100, seed=5, level=0.9)
SHARE = Ratio("pck", "higher", "", "", numerator="hits", denominator="asked")
ERROR = Ratio("rmse_px", "lower", "px", "", numerator="squares", denominator="asked", root=True)
# Pairs of tier 0: sequences 10 to 13, one pair within a sequence, one couple twice; of tier 2: two.
A = np.array([10, 10, 11, 12, 13, 10, 40, 41])
B = np.array([11, 11, 12, 10, 13, 13, 41, 40])
TIER = np.array([0, 0, 0, 0, 0, 0, 2, 2])
COLUMNS = {
    "hits": np.array([1.0, 2, 0, 3, 1, 2, 3, 1]),
    "asked": np.array([4.0, 4, 3, 4, 2, 0, 4, 2]),
    "squares": np.array([9.0, 2, 4, 1, 7, 0, 16, 8]),
}


@pytest.fixture
def crossed() -> Crossing:
    return Crossing.of(A, B, TIER, 3)


@pytest.mark.parametrize("dense", [0, 32])
def test_effects_are_a_weighted_fit(
    crossed: Crossing, dense: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Values that are sums of effects are given back: each times its weight, in both roles."""
    monkeypatch.setattr(crossing, "_DENSE", dense)
    weight = np.array([3.0, 1, 2, 5, 0, 1, 4])
    np.testing.assert_allclose(
        crossed.effects(0.7 * weight, weight), 0.7 * crossed.shares(weight), atol=1e-8
    )
    values = np.random.default_rng(0).normal(size=7) * weight
    found = crossed.effects(values, weight)
    design = np.zeros((7, 12))
    for row, (source, target) in enumerate(zip(crossed.source, crossed.target, strict=True)):
        design[row, source] = design[row, 6 + target] = 1
    root, total = np.sqrt(weight), design.T @ weight
    scale = np.divide(1, np.sqrt(total), out=np.zeros(12), where=total > 0)
    mean = np.divide(values, weight, out=np.zeros(7), where=weight > 0)
    solution = scale * (np.linalg.pinv(root[:, None] * design * scale) @ (root * mean))
    np.testing.assert_allclose(found, (total * solution).reshape(2, 6).sum(axis=0), atol=1e-7)
    assert found.sum() == pytest.approx(values.sum(), abs=1e-7)


def test_replicates_weigh_a_pair_by_both_sequences(
    crossed: Crossing, monkeypatch: pytest.MonkeyPatch
) -> None:
    terms = np.stack([COLUMNS["hits"], COLUMNS["asked"]], axis=1)
    found = replicates(crossed, terms, SETTINGS)
    assert found.shape == (100, 3, 2)
    assert not found[:, 1].any()
    members = {0: [10, 11, 12, 13], 2: [40, 41]}
    for tier, names in members.items():
        rng = np.random.default_rng([5, len(names)])
        for replicate, drawn in enumerate(rng.choice(names, (100, len(names))).tolist()):
            expected = np.zeros(2)
            for a, b, row in zip(A, B, terms, strict=True):
                expected += row * drawn.count(a) * (1 if a == b else drawn.count(b))
            np.testing.assert_allclose(found[replicate, tier], expected)
    monkeypatch.setattr(bootstrap, "_CHUNK_CELLS", 7 * 30)  # 30 replicates at once
    np.testing.assert_allclose(replicates(crossed, terms, SETTINGS), found)


def test_intervals_of_every_group(crossed: Crossing) -> None:
    found = intervals([SHARE, ERROR], COLUMNS, crossed, SETTINGS)
    assert [set(each) for each in found] == [
        {"pck", "rmse_px"},
        {"pck", "rmse_px"},
        set(),
        set(),  # two sequences
    ]
    names = ("hits", "asked", "squares")
    drawn = replicates(crossed, np.stack([COLUMNS[name] for name in names], axis=1), SETTINGS)
    for group, mine, extent in (
        (0, TIER >= 0, (6, 2)),
        (1, TIER == 0, (4, 1)),
    ):
        sums = drawn.sum(axis=1) if group == 0 else drawn[:, group - 1]
        sums = sums[sums[:, 1] > 0]
        hits, asked, squares = (COLUMNS[name][mine].sum() for name in names)
        expected = interval(SHARE, hits / asked, sums[:, 0] / sums[:, 1], 0.9, *extent)
        assert found[group]["pck"] == pytest.approx(expected)
        values = np.sqrt(sums[:, 2] / sums[:, 1])
        expected = interval(ERROR, math.sqrt(squares / asked), values, 0.9, *extent)
        assert found[group]["rmse_px"] == pytest.approx(expected)
    single = Crossing.of(A[:5] * 0, B[:5] * 0, TIER[:5], 1)
    five = {name: values[:5] for name, values in COLUMNS.items()}
    assert intervals([SHARE], five, single, SETTINGS) == [{}, {}]
    nothing = {**five, "asked": np.zeros(5)}
    assert intervals([SHARE], nothing, Crossing.of(A[:5], B[:5], TIER[:5], 1), SETTINGS) == [{}, {}]


@pytest.mark.parametrize("defined", [1, 2, 3, 5])
def test_sequences_that_do_not_define_a_metric_do_not_count(defined: int) -> None:
    """Twelve sequences, only some of which ask anything."""
    ids, some = np.arange(12), np.arange(12) < defined
    crossed = Crossing.of(ids, ids, np.zeros(12, np.int64), 1)
    columns = {"squares": np.where(some, 1.0 + ids, 0), "asked": some * 1.0}
    found = intervals([ERROR], columns, crossed, SETTINGS)
    assert found[0] == found[1]
    if defined < 3:  # of one sequence all replicates would be equal
        assert found[0] == {}
        return
    sums = replicates(crossed, np.stack([*columns.values()], axis=1), SETTINGS)[:, 0]
    sums = sums[sums[:, 1] > 0]
    score = math.sqrt(columns["squares"].sum() / defined)
    expected = interval(ERROR, score, np.sqrt(sums[:, 0] / sums[:, 1]), 0.9, defined, 1)
    assert found[0]["rmse_px"] == pytest.approx(expected)


def test_tiers_of_one_size_are_drawn_independently() -> None:
    """Two tiers whose sequences mirror each other: drawn alike, they would always cancel out."""
    count = 8
    ids = np.arange(2 * count)
    crossed = Crossing.of(ids, ids, np.repeat([0, 1], count), 2)
    hits = np.linspace(0, 10, count)
    columns = {"hits": np.append(hits, 10 - hits), "asked": np.full(2 * count, 10.0)}
    settings = Bootstrap(unit="sequences", replicates=2000, seed=0, level=0.95)
    low, high = intervals([SHARE], columns, crossed, settings)[0]["pck"]
    error = np.sqrt(2 * hits.var(ddof=1) / count) / 20  # of the mean of two independent means
    assert (high - low) / 2 == pytest.approx(stats.t(14).ppf(0.975) * error, rel=0.1)


def test_a_tier_of_one_sequence_has_no_interval_and_neither_has_the_whole() -> None:
    alone = np.array([10, 11, 12, 40])
    crossed = Crossing.of(alone, alone, np.array([0, 0, 0, 1]), 2)
    assert crossed.extent(0) == (4, 2)
    four = {name: values[:4] for name, values in COLUMNS.items()}
    found = intervals([SHARE], four, crossed, SETTINGS)
    assert [set(each) for each in found] == [set(), {"pck"}, set()]


def test_an_interval_by_hand() -> None:
    values = np.array([1.0, 2, 4, 8])
    t = stats.t(3).ppf(0.95)
    reach = math.sqrt(5 / 3) * t * np.log(values).std()
    middle = 2 * math.log(3) - np.log(values).mean()
    found = interval(ERROR, 3.0, values, 0.9, 5, 2)
    assert found == pytest.approx([math.exp(middle - reach), math.exp(middle + reach)])
    tail = stats.norm.cdf(-math.sqrt(5 / 3) * t)
    quantiles = np.quantile(values, [tail, 1 - tail])
    assert interval(SHARE, 3.0, values, 0.9, 5, 2) == pytest.approx(quantiles)
    assert interval(ERROR, 0.0, values, 0.9, 5, 2) == pytest.approx(quantiles)
    small = interval(ERROR, 0.03, values / 100, 0.9, 5, 2)
    assert small == pytest.approx([math.exp(middle - reach) / 100, math.exp(middle + reach) / 100])
    values[0] = 0
    assert interval(ERROR, 3.0, values, 0.9, 5, 2)[0] < 1
    with pytest.raises(CallError, match=r"^level: "):
        Bootstrap(unit="sequences", replicates=100, seed=0, level=1.0)


@pytest.mark.parametrize("root", [False, True])
def test_a_paired_difference_by_hand(root: bool) -> None:
    """Seven episodes, in some of which one method counts fewer queries, and one that has none."""
    count = 8
    ids = np.arange(count)
    crossed = Crossing.of(ids, ids, np.zeros(count, np.int64), 1)
    rng = np.random.default_rng(2)
    first = rng.uniform(1, 5, count), np.array([4.0, 4, 3, 4, 2, 4, 4, 0])
    second = rng.uniform(0, 3, count), np.array([4.0, 4, 4, 4, 4, 4, 3, 0])
    first[0][-1] = second[0][-1] = 0
    ratio = ERROR if root else SHARE
    level = 0.95
    found = paired_difference(ratio, first, second, crossed, level)
    score = [sums[0].sum() / sums[1].sum() for sums in (first, second)]
    if root:
        score = [math.sqrt(each) for each in score]
    assert found.value == pytest.approx(score[1] - score[0])
    below = first[1] + second[1]
    pooled = (first[0].sum() + second[0].sum()) / below.sum()
    effect = (second[0] - pooled * second[1]) - (first[0] - pooled * first[1])
    effect *= found.value / effect.sum()
    share = below / below.sum()
    used = range(7)
    means = sorted(
        sum(effect[list(chosen)]) / sum(share[list(chosen)])
        for size in range(1, 8)
        for chosen in itertools.combinations(used, size)
    )
    rank = math.floor(0.025 * (len(means) + 1) + 1e-9)
    assert found.sequences == 7
    assert (found.low, found.high) == pytest.approx((means[rank - 1], means[-rank]))
    spread = math.sqrt(7 / 6 * sum((effect - found.value * share)[:7] ** 2))
    z, power = NormalDist().inv_cdf(0.975), NormalDist().inv_cdf(0.8)
    needed = 7 * ((z + power) * spread / found.value) ** 2 + z**2 / 2
    assert found.sequences_needed == max(6, math.ceil(needed))


def test_differences_that_are_not_defined() -> None:
    ids = np.arange(6)
    crossed = Crossing.of(ids, ids, np.zeros(6, np.int64), 1)
    same = np.arange(1.0, 7), np.full(6, 4.0)
    equal = paired_difference(SHARE, same, same, crossed, 0.95)
    assert (equal.value, equal.low, equal.high, equal.sequences_needed) == (0, 0, 0, None)
    none = np.zeros(6), np.zeros(6)
    missing = paired_difference(SHARE, none, same, crossed, 0.95)
    assert math.isnan(missing.value)
    assert math.isnan(missing.low)
    assert math.isnan(missing.high)
    assert (missing.sequences, missing.sequences_needed) == (6, None)
    # Equal sums in other pairs: the value is 0, the effects are not.
    turned = same[0][::-1].copy(), same[1]
    other = paired_difference(SHARE, same, turned, crossed, 0.95)
    assert other.value == 0
    assert other.low < 0 < other.high
    # Of methods that are right in other halves of the sequences no mean can be beyond +-0.5.
    left, right = np.repeat([2.0, 0.0], 3), np.repeat([0.0, 2.0], 3)
    halves = paired_difference(SHARE, (left, same[1]), (right, same[1]), crossed, 0.95)
    assert (halves.value, halves.low, halves.high) == pytest.approx((0, -0.5, 0.5))
    roots = paired_difference(ERROR, (left, same[1]), (right, same[1]), crossed, 0.95)
    assert (roots.value, roots.low, roots.high) == pytest.approx((0, -0.5, 0.5))
    perfect = paired_difference(ERROR, none[:1] + same[1:], none[:1] + same[1:], crossed, 0.95)
    assert (perfect.value, perfect.low, perfect.high) == (0, 0, 0)
    one = Crossing.of(ids[:1], ids[:1], np.zeros(1, np.int64), 1)
    single = paired_difference(
        SHARE, (same[0][:1], same[1][:1]), (np.ones(1) * 9, same[1][:1]), one, 0.95
    )
    assert single.sequences_needed is None
    two = Crossing.of(ids[:2], ids[:2], np.zeros(2, np.int64), 1)
    pair = paired_difference(
        SHARE, (same[0][:2], same[1][:2]), (turned[0][:2], same[1][:2]), two, 0.95
    )
    assert pair.sequences_needed is not None
    assert [fewest_sequences(level) for level in (0.5, 0.75, 0.9, 0.95)] == [2, 3, 5, 6]


def test_an_unclear_difference_needs_very_many_sequences_and_a_clear_one_six() -> None:
    ids = np.arange(8)
    crossed = Crossing.of(ids, ids, np.zeros(8, np.int64), 1)
    asked = np.full(8, 4.0)
    base = np.full(8, 2.0, np.float64)
    clear = paired_difference(SHARE, (base, asked), (base + 1.0, asked), crossed, 0.95)
    assert clear.sequences_needed == 6
    tiny = np.array([1.0, -1.0] * 4, np.float64) + 1e-9
    unclear = paired_difference(SHARE, (base, asked), (base + tiny, asked), crossed, 0.95)
    assert unclear.sequences_needed == 10**9
    # Differences of 1 + 1.5 and 1 - 1.5: 8 (1.960 + 0.842)^2 1.5^2 / 7 + 1.960^2 / 2 = 22.1.
    spread = paired_difference(SHARE, (base, asked), (base + [2.5, -0.5] * 4, asked), crossed, 0.95)
    assert spread.sequences_needed == 23


def test_intervals_cover_what_they_should() -> None:
    """Of 400 made-up datasets with a known mean, about 95 % of the intervals hold it."""
    settings = SETTINGS.replace(replicates=400, seed=0, level=0.95)
    rng = np.random.default_rng(0)
    sequences, pairs = 8, 5
    hits = 0
    for _ in range(400):
        per_sequence = rng.normal(10, 3, sequences)
        values = np.repeat(per_sequence, pairs) + rng.normal(0, 1, sequences * pairs)
        codes = np.repeat(np.arange(sequences), pairs)
        crossing = Crossing.of(codes, codes, np.zeros(len(codes), int), 1)
        columns = {"hits": values, "asked": np.ones(len(values))}
        low, high = intervals([SHARE], columns, crossing, settings)[0]["pck"]
        hits += low <= 10 <= high
    assert 0.92 <= hits / 400 <= 0.98
