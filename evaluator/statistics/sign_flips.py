"""Paired differences of two methods: a sign-flip test, and the interval that belongs to it.

The difference of two methods in a pair is taken as the sum of an effect of its source sequence
and one of its target sequence. The effects are fitted to all pairs, and those of a sequence in both
roles are exchanged together, in every subset of the sequences (Fisher, The Design of Experiments,
1935, section 21). Exchanging by source sequence alone would treat pairs that share a target as
independent: in simulations that gives up to 30 % false verdicts instead of 5 %.

Where pairs stay within sequences, as in episodes, the level is exact for methods that are equal in
law. Where they cross two sequences it is approximate, because effects are fitted, and what is left
of a pair is shared out to its sequences; `benchmarks/interval_coverage.py` measures it.
The interval runs between two order statistics of the mean difference over the subsets (Hartigan,
Using Subsample Values as Typical Values, JASA 64, 1969).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np

from pliant.evaluator.statistics.crossing import Crossing
from pliant.evaluator.statistics.ratios import Ratio
from pliant.spec.arrays import FloatArray

_GENERATORS: Final = 12
"""Up to so many sequences every subset is tried; of more, a group of 2^12 of them."""

_POWER: Final = 0.8


@dataclass(frozen=True)
class PairedDifference:
    """How much two methods differ by one metric.

    Attributes:
        value: The second method's score minus the first's; NaN where either is not defined.
        low, high: The interval; NaN with fewer sequences than `fewest_sequences`.
        sequences: Number of sequences that define the metric.
        sequences_needed: Number of sequences, of the same kind, at which a test finds a
            difference of this size in 80 % of all cases (normal approximation, not below
            `fewest_sequences`); None where the methods do not differ, or cannot be compared.
    """

    value: float
    low: float
    high: float
    sequences: int
    sequences_needed: int | None


def fewest_sequences(level: float) -> int:
    """Return with how many sequences an interval of a level first exists: 6 for 0.95.

    n sequences have 2^n sign patterns, and the most extreme one on each side has probability
    2^-n: the interval needs 2^-n <= (1 - level) / 2.
    """
    return math.ceil(math.log2(2 / (1 - level)) - 1e-9)


def paired_difference(
    ratio: Ratio,
    first: tuple[FloatArray, FloatArray],
    second: tuple[FloatArray, FloatArray],
    crossing: Crossing,
    level: float,
) -> PairedDifference:
    """Compare two methods over the same pairs.

    Args:
        ratio: The metric.
        first: What `ratio` sums above and below by the first method, summed up for each
            couple of sequences, float64 (E,) each; zero below leaves a couple out.
        second: The same of the second method.
        crossing: The couples.
        level: Nominal coverage of the interval, 0 to 1.

    Returns:
        The difference; its interval excludes zero exactly where the two-sided sign-flip test
        rejects at 1 - `level`.
    """
    below = first[1] + second[1]
    total = below.sum()
    share = crossing.shares(below) / max(total, 1e-300)
    used = share > 0
    sequences = int(used.sum())
    scores = _score(ratio, first), _score(ratio, second)
    value = scores[1] - scores[0]
    if not np.isfinite(value):
        return PairedDifference(math.nan, math.nan, math.nan, sequences, None)
    # Linear in the pairs, about the quotient of both methods together: exchanging the methods
    # changes the sign of an effect and nothing else.
    pooled = (first[0].sum() + second[0].sum()) / total
    differences = second[0] - pooled * second[1] - first[0] + pooled * first[1]
    # They sum to `value` in units of the metric; a quotient of both would fail where that is 0.
    differences *= total / (2 * first[1].sum() * second[1].sum())
    if ratio.root and not ratio.over_pairs:
        differences /= max(sum(scores), 1e-300)
    effect, share = crossing.effects(differences, below)[used], share[used]
    low, high = _interval(effect, share, level)
    needed = None if value == 0 else _sequences_needed(effect, share, level)
    return PairedDifference(value, low, high, sequences, needed)


def _score(ratio: Ratio, sums: tuple[FloatArray, FloatArray]) -> float:
    return float(ratio.finish(sums[0].sum(keepdims=True), sums[1].sum(keepdims=True))[0])


def _interval(effect: FloatArray, share: FloatArray, level: float) -> tuple[float, float]:
    if len(effect) < fewest_sequences(level):
        return math.nan, math.nan
    subsets = _subsets(len(effect))
    means = (subsets @ effect) / (subsets @ share)
    # A shift d is refused where 1 + #{means <= d} (1: nothing exchanged) is at most a tail.
    rank = math.floor((1 - level) / 2 * (len(means) + 1) + 1e-9)
    ordered = np.partition(means, (rank - 1, len(means) - rank))
    return float(ordered[rank - 1]), float(ordered[len(means) - rank])


@functools.lru_cache(maxsize=8)
def _subsets(sequences: int) -> FloatArray:
    """Return subsets of the sequences, none empty, as rows of 0 and 1, float64 (S, C).

    With the empty one they form a group under symmetric difference, which a test needs whose
    subsets are not all tried.
    """
    count = min(sequences, _GENERATORS)
    bits = np.arange(count)
    chosen = (np.arange(1, 2**count)[:, None] >> bits) & 1  # (S, count)
    # A further sequence follows a combination of the first ones.
    further = np.random.default_rng(sequences).integers(1, 2**count, sequences - count)
    followed = np.concatenate(
        [np.eye(count, dtype=np.int64), (further >> bits[:, None]) & 1], axis=1
    )
    return (chosen @ followed % 2).astype(np.float64)


def _sequences_needed(effect: FloatArray, share: FloatArray, level: float) -> int | None:
    sequences = len(effect)
    value = effect.sum()
    if sequences < 2:
        return None
    spread = math.sqrt(sequences / (sequences - 1) * np.sum((effect - value * share) ** 2))
    quantile = NormalDist().inv_cdf
    z = quantile((1 + level) / 2)
    # The last term is what estimating the spread costs (Guenther, The American Statistician 35,
    # 1981).
    needed = sequences * ((z + quantile(_POWER)) * spread / value) ** 2 + z**2 / 2
    return max(fewest_sequences(level), math.ceil(min(needed, 1e9)))
