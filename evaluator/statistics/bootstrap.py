"""Confidence intervals by resampling both sequences of every pair.

Queries of one image pair, and pairs that share a sequence, err together: only sequences are
independent. A replicate draws, in every tier, as many sequences as there are, with replacement; a
pair of two sequences counts as often as the product of how often both are drawn (the pigeonhole
bootstrap: Owen, The Pigeonhole Bootstrap, Annals of Applied Statistics 1, 2007), a pair within one
sequence as often as that is drawn.

Resampling few sequences gives too narrow intervals, so both kinds are widened by Student's t and
by n / (n - 1). A share has the expanded percentile interval (Hesterberg, What Teachers Should Know
About the Bootstrap, The American Statistician 69, 2015). A quantity with a unit, such as an error
in pixels, depends on few large values, which a small sample may lack: its interval is symmetric in
the logarithm, about the logarithm corrected for the bias of the replicates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Final, Literal

import numpy as np

from pliant.evaluator.statistics.crossing import Crossing
from pliant.evaluator.statistics.ratios import Ratio
from pliant.spec.arrays import BoolArray, FloatArray, IntArray
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds

_CHUNK_CELLS: Final = 1 << 22
_LEAST_FREEDOM: Final = 2  # with one degree of freedom, Student's t says nothing


class Bootstrap(Settings):
    """How confidence intervals are drawn.

    Attributes:
        unit: What is resampled: the sequences of both frames of a pair.
        replicates: Number of replicates.
        seed: Random seed.
        level: Nominal coverage.
    """

    unit: Literal["sequences"]
    replicates: Annotated[int, Bounds(100)]
    seed: Annotated[int, Bounds(0)]
    level: Annotated[float, Bounds(0, 1, above=True, below=True)]


def replicates(crossing: Crossing, terms: FloatArray, settings: Bootstrap) -> FloatArray:
    """Return the sums of pair terms in every replicate, by tier.

    Args:
        crossing: The sequences of the pairs.
        terms: float64 (P, M), what is summed.
        settings: A protocol's `bootstrap`.

    Returns:
        float64 (B, T, M).
    """
    sizes = crossing.sizes()
    by_couple = np.stack([crossing.sum(column) for column in terms.T], axis=1)  # (E, M)
    count = settings.replicates
    result = np.zeros((count, crossing.tiers, terms.shape[1]))
    for tier in range(crossing.tiers):
        mine = crossing.of_group(tier + 1)
        # One generator a tier: a tier's intervals do not depend on which others there are.
        rng = np.random.default_rng([settings.seed, int(sizes[tier])])
        begin = 0
        for drawn in _drawn(rng, crossing.tier == tier, int(mine.sum()), count):
            weights = crossing.weights(drawn)[:, mine]
            result[begin : begin + len(weights), tier] = weights @ by_couple[mine]
            begin += len(weights)
    return result


def _drawn(
    rng: np.random.Generator, members: BoolArray, couples: int, count: int
) -> Iterator[FloatArray]:
    """Yield how often each of `members` is drawn, float64 (b, C), `count` rows in all."""
    among = np.flatnonzero(members)
    if not len(among):
        return
    step = max(1, min(count, _CHUNK_CELLS // max(len(members), couples)))
    for begin in range(0, count, step):
        rows = min(step, count - begin)
        places = rng.choice(among, (rows, len(among))) + np.arange(rows)[:, None] * len(members)
        cells = np.bincount(places.ravel(), minlength=rows * len(members))
        yield cells.reshape(rows, len(members)) * 1.0


def intervals(
    ratios: list[Ratio],
    columns: Mapping[str, FloatArray],
    crossing: Crossing,
    settings: Bootstrap,
) -> list[dict[str, list[float]]]:
    """Return an interval of every ratio, overall and for each tier.

    Args:
        ratios: The metrics.
        columns: The pair table.
        crossing: The sequences of the pairs.
        settings: A protocol's `bootstrap`.

    Returns:
        One mapping of metric to [low, high] for the whole split, then one a tier. A metric is
        left out where it is not defined, and where fewer than three sequences of a tier define it.
    """
    pairs = [ratio.terms(columns) for ratio in ratios]
    terms = np.stack([side for pair in pairs for side in pair], axis=1)
    drawn = replicates(crossing, terms, settings)  # (B, T, 2M)
    defined = [crossing.shares(crossing.sum(below)) > 0 for _, below in pairs]  # (C,) each
    tier_of_pair = crossing.tier[crossing.source[crossing.couple]]
    sizes = crossing.sizes()
    result = []
    for group in range(crossing.tiers + 1):
        sums = _whole(drawn, sizes) if group == 0 else drawn[:, group - 1]
        counted = (tier_of_pair == group - 1) | (group == 0)
        whole = terms[counted].sum(axis=0, keepdims=True)  # (1, 2M)
        found: dict[str, list[float]] = {}
        for index, ratio in enumerate(ratios):
            above, below = 2 * index, 2 * index + 1
            sequences, tiers = crossing.extent(group, defined[index])
            alone = group == 0 and (crossing.sizes(defined[index]) == 1).any()
            enough = sequences - tiers >= _LEAST_FREEDOM and not alone
            values = ratio.finish(sums[:, above], sums[:, below])
            values = values[np.isfinite(values)]
            if enough and len(values):
                score = float(ratio.finish(whole[:, above], whole[:, below])[0])
                found[ratio.name] = interval(ratio, score, values, settings.level, sequences, tiers)
        result.append(found)
    return result


def _whole(drawn: FloatArray, sizes: IntArray) -> FloatArray:
    """Return the sums over all tiers in every replicate, float64 (B, M).

    Tiers of one size draw the same places in the same replicates: each is shifted by as many
    replicates as there are earlier ones of its size, so that the tiers are drawn independently.
    """
    total = np.zeros((len(drawn), drawn.shape[2]))
    for tier, size in enumerate(sizes):
        total += np.roll(drawn[:, tier], (sizes[:tier] == size).sum(), axis=0)
    return total


def interval(
    ratio: Ratio, score: float, values: FloatArray, level: float, sequences: int, tiers: int
) -> list[float]:
    """Return the interval of a score, [low, high].

    Args:
        ratio: The metric; its unit decides the kind of interval.
        score: Its value over all pairs.
        values: float64 (B,), its value in each replicate.
        level: Nominal coverage.
        sequences: Number of resampled sequences that define the metric.
        tiers: Number of tiers they were drawn within.
    """
    from scipy.special import ndtr, stdtrit  # takes 0.1 s to load

    # Resampling n values makes a variance too small by (n - 1) / n and knows no t distribution;
    # every further tier has its own mean.
    freedom = sequences - tiers
    widened = math.sqrt(sequences / freedom) * float(stdtrit(freedom, (1 - level) / 2))
    if ratio.unit and score > 0 and values.min() > 0:
        logarithms = np.log(values)
        middle = 2 * math.log(score) - logarithms.mean()
        reach = -widened * logarithms.std()
        return [math.exp(middle - reach), math.exp(middle + reach)]
    tail = float(ndtr(widened))
    low, high = np.quantile(values, [tail, 1 - tail])
    return [float(low), float(high)]
