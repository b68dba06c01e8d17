"""How often `pliant compare` calls equal methods different, and what it finds when they differ.

    python benchmarks/interval_coverage.py [--quick] [--json FILE]

Simulates two methods on n sequences of 20 queries. A sequence has a difficulty that both methods
share and an effect of each method; both effects are normal or log-normal, so errors have a few or
many outliers. Keys end in `METRIC_EFFECT_n`:

- `false_verdict_rate_…`: share of comparisons of methods equal in law that end in a verdict;
  `false_verdict_rate_max` is the largest, and `false_verdict_rate_standard_error` the Monte Carlo
  standard error of a single rate of 0.05.
- `power_…`: share of verdicts when one method's errors are 1.3 times as large.
- `bootstrap_…`: both by resampled differences (expanded percentile interval) instead.
- `unequal_law_rate_…`: share of verdicts when both methods have the same expected score but only
  one has an effect of its own. The test does not promise a level here.
- `single_coverage_…`: share of a single method's intervals that contain its expected score.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from record import Value, main

from pliant.evaluator.statistics.bootstrap import (
    Bootstrap,
    Clusters,
    percentile_interval,
    replicates,
)
from pliant.evaluator.statistics.ratios import Ratio
from pliant.evaluator.statistics.sign_flips import paired_difference
from pliant.spec.arrays import FloatArray

LEVEL: Final = 0.95
SEQUENCES: Final = (6, 8, 16, 30)
EFFECTS: Final = ("normal", "log-normal")
QUERIES: Final = 20
GAIN: Final = 1.3
RATIOS: Final = {
    "rmse": Ratio("rmse", "lower", "px", "", "", "above", "below", root=True),
    "pck": Ratio("pck", "higher", "", "", "", "above", "below"),
}


@dataclass(frozen=True)
class Methods:
    """The sums of two methods over each sequence.

    Attributes:
        above: Metric -> float64 (2, n), squared errors in px2 or answers within 16 px.
        below: float64 (n,), queries.
    """

    above: Mapping[str, FloatArray]
    below: FloatArray

    def of(self, metric: str, method: int) -> tuple[FloatArray, FloatArray]:
        """Return what the metric sums above and below for one method."""
        return self.above[metric][method], self.below


def simulate(
    rng: np.random.Generator, count: int, effect: str, *, gain: float = 1.0, own: float = 1.0
) -> Methods:
    """Draw two methods.

    Args:
        rng: Source of randomness.
        count: Number of sequences.
        effect: Normal (standard deviation 30 % each) or log-normal (0.5 each).
        gain: Factor on the second method's errors.
        own: Factor on the second method's own effect; 0 leaves the shared difficulty.
    """
    shared, effects = rng.normal(size=count), rng.normal(size=(2, count))
    effects[1] *= own
    if effect == "normal":
        scale = 10 * np.maximum(1 + 0.3 * shared + 0.3 * effects, 0.05)
    else:
        scale = 10 * np.exp(0.5 * shared + 0.5 * effects)
    scale[1] *= gain
    error = scale[..., None] * np.hypot(*rng.normal(size=(2, 2, count, QUERIES)))
    above = {"rmse": (error**2).sum(axis=2), "pck": (error <= 16.0).sum(axis=2) * 1.0}
    return Methods(above, np.full(count, float(QUERIES)))


def expected(effect: str, *, own: float = 1.0) -> dict[str, FloatArray]:
    """Return both methods' expected scores by metric, float64 (2,), from many sequences."""
    rng = np.random.default_rng(1)
    drawn = simulate(rng, 200_000, effect, own=own)
    return {
        metric: np.array([_score(RATIOS[metric], *drawn.of(metric, method)) for method in (0, 1)])
        for metric in RATIOS
    }


def verdict(methods: Methods, metric: str) -> bool:
    """Return whether the shipped comparison calls two methods different."""
    first, second = (methods.of(metric, method) for method in (0, 1))
    found = paired_difference(RATIOS[metric], first, second, LEVEL)
    return found.low > 0 or found.high < 0


def bootstrap_verdict(methods: Methods, metric: str) -> bool:
    """Return whether the interval of resampled differences excludes zero."""
    (above, below), (other, _) = (methods.of(metric, method) for method in (0, 1))
    sums = _resampled(np.stack([above, other, below], axis=1))
    ratio = RATIOS[metric]
    spread = ratio.finish(sums[:, 1], sums[:, 2]) - ratio.finish(sums[:, 0], sums[:, 2])
    low, high = percentile_interval(spread, LEVEL, len(below), 1)
    return low > 0 or high < 0


def covers(methods: Methods, metric: str, value: float) -> bool:
    """Return whether the first method's own interval contains a value."""
    above, below = methods.of(metric, 0)
    sums = _resampled(np.stack([above, below], axis=1))
    spread = RATIOS[metric].finish(sums[:, 0], sums[:, 1])
    low, high = percentile_interval(spread, LEVEL, len(below), 1)
    return low <= value <= high


def measure(quick: bool) -> Mapping[str, Value]:
    """Return the rates."""
    many, few = (3_000, 300) if quick else (20_000, 2_000)
    figures: dict[str, Value] = {"comparisons": many, "bootstrap_comparisons": few}
    false: list[float] = []
    for effect, count in itertools.product(EFFECTS, SEQUENCES):
        truth = expected(effect)
        uneven = expected(effect, own=0.0)["rmse"]
        rng = np.random.default_rng([count, EFFECTS.index(effect)])
        equal = [simulate(rng, count, effect) for _ in range(many)]
        better = [simulate(rng, count, effect, gain=GAIN) for _ in range(few)]
        gain = float(uneven[0] / uneven[1])
        unequal = [simulate(rng, count, effect, own=0.0, gain=gain) for _ in range(few)]
        for metric in RATIOS:
            key = f"{metric}_{effect}_{count}"
            false.append(_share([verdict(item, metric) for item in equal]))
            figures |= {
                f"false_verdict_rate_{key}": false[-1],
                f"power_{key}": _share([verdict(item, metric) for item in better]),
                f"bootstrap_false_verdict_rate_{key}": _share(
                    [bootstrap_verdict(item, metric) for item in equal[:few]]
                ),
                f"bootstrap_power_{key}": _share(
                    [bootstrap_verdict(item, metric) for item in better]
                ),
                f"single_coverage_{key}": _share(
                    [covers(item, metric, float(truth[metric][0])) for item in equal[:few]]
                ),
            }
        figures[f"unequal_law_rate_rmse_{effect}_{count}"] = _share(
            [verdict(item, "rmse") for item in unequal]
        )
    figures["false_verdict_rate_max"] = max(false)
    figures["false_verdict_rate_standard_error"] = float(np.sqrt(0.05 * 0.95 / many))
    return figures


def _score(ratio: Ratio, above: FloatArray, below: FloatArray) -> float:
    return float(ratio.finish(above.sum(keepdims=True), below.sum(keepdims=True))[0])


def _resampled(terms: FloatArray) -> FloatArray:
    """Return the sums of sequences' terms, (n, M), in every replicate, float64 (B, M)."""
    count = len(terms)
    clusters = Clusters(np.arange(count), np.zeros(count, np.int64), 1)
    return replicates(clusters, terms, Bootstrap("sequence_a", 1000, 0, 0.95))[:, 0]


def _share(found: list[bool]) -> float:
    return float(np.mean(found))


if __name__ == "__main__":
    main("coverage", measure, __doc__)
