"""Confidence intervals by resampling whole sequences.

Queries of one image pair, and pairs of one sequence, err together: only sequences are
independent. A replicate draws, in every tier, as many source sequences as there are, with
replacement (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 13). The plain
percentile interval is too narrow when sequences are few; it is widened as Hesterberg proposes
(What Teachers Should Know About the Bootstrap, The American Statistician 69, 2015, "expanded
percentile"), so that of 95 % intervals over ten sequences about 95 % hold the truth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import numpy as np
from scipy.special import ndtr, stdtrit

from pliant.evaluator.statistics.ratios import Ratio
from pliant.spec.arrays import FloatArray, IndexArray, IntArray
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds

_CHUNK_CELLS: Final = 1 << 22


class Bootstrap(Settings):
    """How confidence intervals are drawn.

    Attributes:
        unit: What is resampled.
        replicates: Number of replicates.
        seed: Random seed.
        level: Nominal coverage.
    """

    unit: Literal["sequence_a"]
    replicates: Annotated[int, Bounds(100)]
    seed: Annotated[int, Bounds(0)]
    level: Annotated[float, Bounds(0, 1, above=True, below=True)]


@dataclass(frozen=True)
class Clusters:
    """Which sequence and tier every pair belongs to.

    Attributes:
        cluster: int64 (P,), the source sequence of each pair, 0 to C - 1.
        tier: int64 (C,), the tier of each sequence.
        tiers: Number of tiers, T.
    """

    cluster: IntArray
    tier: IntArray
    tiers: int

    @classmethod
    def of(cls, sequence: IndexArray, tier: IndexArray, tiers: int) -> Clusters:
        """Number the sequences that occur.

        Args:
            sequence: integer (P,), code of each pair's source sequence.
            tier: integer (P,), code of its tier.
            tiers: Number of tiers.
        """
        _, first, cluster = np.unique(sequence, return_index=True, return_inverse=True)
        return cls(cluster.reshape(-1), np.asarray(tier[first], np.int64), tiers)

    def extent(self, group: int) -> tuple[int, int]:
        """Return (sequences, tiers) of the whole split for 0, of tier `group` - 1 otherwise."""
        sizes = self.sizes()
        if group == 0:
            return int(sizes.sum()), int((sizes > 0).sum())
        return int(sizes[group - 1]), 1

    def sum(self, values: FloatArray) -> FloatArray:
        """Sum values of pairs, float64 (P,), over each sequence, float64 (C,)."""
        sums: FloatArray = np.bincount(self.cluster, values, len(self.tier)).astype(np.float64)
        return sums

    def sizes(self) -> IntArray:
        """Return the number of sequences of each tier, int64 (T,)."""
        return np.bincount(self.tier, minlength=self.tiers)


def replicates(clusters: Clusters, terms: FloatArray, settings: Bootstrap) -> FloatArray:
    """Return the sums of pair terms in every replicate, by tier.

    Args:
        clusters: The resampled units.
        terms: float64 (P, M), what is summed.
        settings: A protocol's `bootstrap`.

    Returns:
        float64 (B, T, M).
    """
    sizes = clusters.sizes()
    by_cluster = np.stack([clusters.sum(column) for column in terms.T], axis=1)  # (C, M)
    count = settings.replicates
    result = np.zeros((count, clusters.tiers, terms.shape[1]))
    for tier in range(clusters.tiers):
        members = by_cluster[clusters.tier == tier]
        # One generator a tier: a tier's intervals do not depend on which others there are.
        rng = np.random.default_rng([settings.seed, int(sizes[tier])])
        begin = 0
        for weights in _weights(rng, len(members), count):
            result[begin : begin + len(weights), tier] = weights @ members
            begin += len(weights)
    return result


def _weights(rng: np.random.Generator, members: int, count: int) -> Iterator[FloatArray]:
    """Yield how often each of `members` is drawn, float64 (b, members), `count` rows in all."""
    if not members:
        return
    step = max(1, min(count, _CHUNK_CELLS // members))
    for begin in range(0, count, step):
        rows = min(step, count - begin)
        drawn = rng.integers(0, members, (rows, members))
        drawn += np.arange(rows)[:, None] * members
        yield np.bincount(drawn.ravel(), minlength=rows * members).reshape(rows, members) * 1.0


def intervals(
    ratios: list[Ratio],
    columns: Mapping[str, FloatArray],
    clusters: Clusters,
    settings: Bootstrap,
) -> list[dict[str, list[float]]]:
    """Return percentile intervals of every ratio, overall and for each tier.

    Args:
        ratios: The metrics.
        columns: The pair table.
        clusters: The resampled units.
        settings: A protocol's `bootstrap`.

    Returns:
        One mapping of metric to [low, high] for the whole split, then one a tier. A metric is
        left out where it is not defined, and everywhere in a tier of a single sequence.
    """
    pairs = [ratio.terms(columns) for ratio in ratios]
    terms = np.stack([side for pair in pairs for side in pair], axis=1)
    drawn = replicates(clusters, terms, settings)  # (B, T, 2M)
    sizes = clusters.sizes()
    result = []
    for group in range(clusters.tiers + 1):
        sums = drawn.sum(axis=1) if group == 0 else drawn[:, group - 1]
        enough = bool((sizes[sizes > 0] > 1).all()) if group == 0 else sizes[group - 1] > 1
        found: dict[str, list[float]] = {}
        for index, ratio in enumerate(ratios):
            values = ratio.finish(sums[:, 2 * index], sums[:, 2 * index + 1])
            values = values[np.isfinite(values)]
            if enough and len(values):
                found[ratio.name] = percentile_interval(
                    values, settings.level, *clusters.extent(group)
                )
        result.append(found)
    return result


def percentile_interval(
    values: FloatArray, level: float, sequences: int, tiers: int
) -> list[float]:
    """Return the expanded percentile interval of replicates.

    Args:
        values: float64 (B,), the metric in each replicate.
        level: Nominal coverage.
        sequences: Number of resampled sequences.
        tiers: Number of tiers they were drawn within.

    Returns:
        [low, high].
    """
    tail = expanded_tail((1 - level) / 2, sequences, tiers)
    low, high = np.quantile(values, [tail, 1 - tail])
    return [float(low), float(high)]


def expanded_tail(tail: float, sequences: int, tiers: int) -> float:
    """Return the share of replicates to leave out on each side for a nominal tail.

    Resampling n values makes a variance too small by (n - 1) / n and knows no t distribution;
    both are made good: Phi(-sqrt(n / (n - 1)) t), with n - 1 degrees of freedom less one for
    every further tier.

    Args:
        tail: Nominal share on each side.
        sequences: n, more than `tiers`.
        tiers: Tiers that n is drawn within, each with its own mean.
    """
    freedom = sequences - tiers
    return float(ndtr(math.sqrt(sequences / freedom) * stdtrit(freedom, tail)))
