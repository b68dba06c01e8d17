"""Figures of answers with a distribution, worked out row by row without the evaluator."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import multivariate_normal, ncx2

from tests.evaluator.references import mean


def modes_of(answer: dict[str, Any]) -> list[tuple[float, float, float, float]]:
    if answer.get("modes"):
        total = math.fsum(m["weight"] for m in answer["modes"])
        return [
            (m["u"], m["v"], max(m["sigma"], 0.5), m["weight"] / total) for m in answer["modes"]
        ]
    return [(answer["u"], answer["v"], max(answer["sigma"], 0.5), 1.0)]


def reference_distribution(rows: list[dict[str, Any]]) -> dict[str, float | None]:
    nll, recalled, asked, spread = [], 0, 0, []
    bins: list[list[tuple[float, bool]]] = [[] for _ in range(15)]
    seen = [row for row in rows if row["seen"] and row["answer"] is not None]
    inside: dict[float, list[bool]] = {0.5: [], 0.9: [], 0.95: []}
    for row in seen:
        modes = modes_of(row["answer"])
        at = (row["u_b"], row["v_b"])
        p = math.fsum(
            w * multivariate_normal.pdf(at, (u, v), s * s * np.eye(2)) for u, v, s, w in modes
        )
        nll.append(-math.log(0.999 * p + 0.001 / (160 * 120)))
        said = math.fsum(
            w * ncx2.cdf(64 / s**2, 2, max(square(row["answer"], u, v) / s**2, 1e-300))
            for u, v, s, w in modes
        )
        index = max(0, math.ceil(min(said, 1.0) * 15) - 1)
        bins[index].append((said, row["error"] <= 8))
        mu = [math.fsum(m[3] * m[k] for m in modes) for k in (0, 1)]
        inner = math.fsum(
            w * (2 * s * s + (u - mu[0]) ** 2 + (v - mu[1]) ** 2) for u, v, s, w in modes
        )
        spread.append(math.sqrt(inner / 2))
        if len(modes) == 1:
            u, v, s, _ = modes[0]
            for level in inside:
                inside[level].append(
                    math.dist(at, (u, v)) <= s * math.sqrt(-2 * math.log(1 - level))
                )
        partners = [a for a in row["alternatives"] if a["visibility"] == "visible"]
        if partners:
            for position in [at, *((a["u"], a["v"]) for a in partners)]:
                asked += 1
                recalled += any(
                    math.dist(position, (u, v)) <= 16 and w >= 0.05 for u, v, _, w in modes
                )
    gaps = [abs(math.fsum(s for s, _ in b) - sum(h for _, h in b)) for b in bins]
    result = {
        "nll": mean(nll),
        "ece": math.fsum(gaps) / len(seen) if seen else None,
        "mode_recall": recalled / asked if asked else None,
        "ause": reference_ause([row["error"] for row in seen], spread) if seen else None,
    }
    if len(inside[0.5]) == len(seen):
        result |= {f"coverage_{level * 100:g}": mean(inside[level]) for level in inside}
    return result


def square(answer: dict[str, Any], u: float, v: float) -> float:
    return (answer["u"] - u) ** 2 + (answer["v"] - v) ** 2


def reference_ause(errors: list[float], spread: list[float]) -> float:
    """For uncertainties that are all different."""
    assert len(set(spread)) == len(spread)

    def curve(order: list[int]) -> list[float]:
        result = []
        for step in range(100):
            keep = len(order) * (1 - step / 100)
            whole = math.floor(keep)
            total = math.fsum(errors[i] ** 2 for i in order[:whole])
            if whole < len(order):
                total += (keep - whole) * errors[order[whole]] ** 2
            result.append(math.sqrt(total / keep))
        return result

    by_spread = curve(sorted(range(len(errors)), key=lambda i: spread[i]))
    by_error = curve(sorted(range(len(errors)), key=lambda i: errors[i]))
    gap = [(a - b) / by_spread[0] for a, b in zip(by_spread, by_error, strict=True)]
    return math.fsum((a + b) / 2 for a, b in pairwise(gap)) / 100
