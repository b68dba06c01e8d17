"""How often `pliant compare` calls equal methods different, and how often an interval is right.

    python benchmarks/interval_coverage.py [--quick] [--json FILE]

Simulates two methods on n sequences. Every sequence is the target of four others, with 20 queries a
pair. The error of a pair is a product of four factors: how hard its two sequences are for both
methods, and for the method alone. Difficulties are normal or log-normal, so errors have a few or
many outliers. `apart`: a sequence's difficulties as source and as target are independent; `alike`:
they are the same, so that a sequence counts twice. Keys end in `METRIC_EFFECT_ROLES_n`:

- `false_verdict_rate_…`: share of comparisons of methods equal in law that end in a verdict;
  `false_verdict_rate_max` is the largest, and `false_verdict_rate_standard_error` the Monte Carlo
  standard error of a single rate of 0.05. With --quick, `alike` alone is simulated.
- `power_…`: share of verdicts when one method's errors are 1.3 times as large.
- `single_coverage_…`: share of a single method's intervals that contain its expected score;
  `single_coverage_min_20` is the smallest at 20 sequences.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Final

import numpy as np
from record import Value, main

from pliant.evaluator.statistics.bootstrap import Bootstrap, intervals
from pliant.evaluator.statistics.crossing import Crossing
from pliant.evaluator.statistics.ratios import Ratio
from pliant.evaluator.statistics.sign_flips import paired_difference
from pliant.spec.arrays import FloatArray

LEVEL: Final = 0.95
SEQUENCES: Final = (6, 8, 16, 20, 30)
EFFECTS: Final = ("normal", "log-normal")
ROLES: Final = ("apart", "alike")
PAIRS: Final = 4
QUERIES: Final = 20
GAIN: Final = 1.3
SPREAD: Final = {"normal": 0.21, "log-normal": 0.35}
"""Standard deviation of each of the four factors: together 0.42, and 0.7 of the logarithm."""

RATIOS: Final = {
    "rmse": Ratio("rmse", "lower", "px", "", "", "rmse", "below", root=True),
    "pck": Ratio("pck", "higher", "", "", "", "pck", "below"),
}


Methods = tuple[Crossing, list[dict[str, FloatArray]]]
"""The sequences of the pairs (a couple has one pair), and for each method the pair table: squared
errors in px2, answers within 16 px, queries; float64 (P,) each."""


def simulate(
    rng: np.random.Generator, count: int, effect: str, roles: str, gain: float = 1.0
) -> Methods:
    """Draw two methods on `count` sequences; `gain` is a factor on the second one's errors."""
    target = np.repeat(np.arange(count), PAIRS)
    if count <= max(SEQUENCES):
        others = [np.delete(np.arange(count), each) for each in range(count)]
        source = np.concatenate([rng.permutation(each)[:PAIRS] for each in others])
    else:
        source = (target + rng.integers(1, count, len(target))) % count
    shared, own = rng.normal(size=(2, count)), rng.normal(size=(2, 2, count))  # (method,) role
    if roles == "alike":
        shared[1], own[:, 1] = shared[0], own[:, 0]
    hard = (shared + own)[:, 0, source] + (shared + own)[:, 1, target]  # (2, P)
    hard *= SPREAD[effect]
    scale = 10 * (np.maximum(1 + hard, 0.05) if effect == "normal" else np.exp(hard))
    scale[1] *= gain
    error = scale[..., None] * np.hypot(*rng.normal(size=(2, 2, len(target), QUERIES)))
    below = np.full(len(target), float(QUERIES))
    crossing = Crossing.of(source, target, np.zeros(len(target), int), 1)
    return crossing, [
        {"rmse": (each**2).sum(axis=1), "pck": (each <= 16).sum(axis=1) * 1.0, "below": below}
        for each in error
    ]


def expected(effect: str, roles: str) -> dict[str, float]:
    """Return the expected score of a method by metric, from many sequences."""
    table = simulate(np.random.default_rng(1), 200_000, effect, roles)[1][0]
    return {
        name: float(ratio.finish(*(side.sum(keepdims=True) for side in ratio.terms(table)))[0])
        for name, ratio in RATIOS.items()
    }


def verdict(methods: Methods, metric: str) -> bool:
    """Return whether the shipped comparison calls two methods different."""
    ratio, (crossing, columns) = RATIOS[metric], methods
    first, second = (tuple(map(crossing.sum, ratio.terms(each))) for each in columns)
    found = paired_difference(ratio, first, second, crossing, LEVEL)
    return found.low > 0 or found.high < 0


def covered(methods: Methods, truth: Mapping[str, float]) -> dict[str, bool]:
    """Return by metric whether the first method's own interval contains its expected score."""
    settings = Bootstrap(unit="sequences", replicates=1000, seed=0, level=LEVEL)
    found = intervals([*RATIOS.values()], methods[1][0], methods[0], settings)[0]
    return {name: low <= truth[name] <= high for name, (low, high) in found.items()}


def measure(quick: bool) -> Mapping[str, Value]:
    """Return the rates."""
    many, few = (1_500, 100) if quick else (5_000, 1_000)
    figures: dict[str, float] = {"comparisons": many, "intervals": few}
    for effect, roles in itertools.product(EFFECTS, ROLES[1:] if quick else ROLES):
        truth = expected(effect, roles)
        for count in SEQUENCES:
            rng = np.random.default_rng([count, EFFECTS.index(effect), ROLES.index(roles)])
            equal = [simulate(rng, count, effect, roles) for _ in range(many)]
            better = [simulate(rng, count, effect, roles, GAIN) for _ in range(few)]
            right = [covered(item, truth) for item in equal[:few]]
            for metric in RATIOS:
                key = f"{metric}_{effect}_{roles}_{count}"
                verdicts = [verdict(item, metric) for item in equal]
                figures[f"false_verdict_rate_{key}"] = float(np.mean(verdicts))
                verdicts = [verdict(item, metric) for item in better]
                figures[f"power_{key}"] = float(np.mean(verdicts))
                coverage = [item[metric] for item in right]
                figures[f"single_coverage_{key}"] = float(np.mean(coverage))
    rates = [value for key, value in figures.items() if key.startswith("false_verdict_rate_")]
    of_20 = [v for k, v in figures.items() if k.startswith("single_") and k.endswith("_20")]
    return figures | {
        "false_verdict_rate_max": max(rates),
        "false_verdict_rate_standard_error": float(np.sqrt(0.05 * 0.95 / many)),
        "single_coverage_min_20": min(of_20),
    }


if __name__ == "__main__":
    main("coverage", measure, __doc__)
