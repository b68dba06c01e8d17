"""Nearest neighbours among descriptors, by brute force over matrix products."""

from __future__ import annotations

from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import BoolArray, Float32Array, IntArray

Metric = Literal["euclidean", "hamming"]

Descriptors = npt.NDArray[Any]
"""float32 (N, D) for `euclidean`; uint8 (N, D) of packed bits for `hamming`."""

ROWS_AT_ONCE: Final = 256
"""Queries that are compared in one matrix product; bounds the memory."""


def distances(a: Descriptors, b: Descriptors, metric: Metric) -> Float32Array:
    """Return all distances between two sets of descriptors.

    Both are computed as |a|² + |b|² - 2 a·b. For integer-valued descriptors (SIFT as OpenCV
    gives it, and bits) every term is below 2²⁴, so float32 holds it exactly and the result
    does not depend on the order of summation.

    Args:
        a: (N, D) descriptors.
        b: (M, D) descriptors.
        metric: `euclidean` gives |a - b|; `hamming` the number of differing bits.

    Returns:
        float32 (N, M).
    """
    if metric == "hamming":
        a, b = np.unpackbits(a, axis=1), np.unpackbits(b, axis=1)
    a = a.astype(np.float32, copy=False)
    b = b.astype(np.float32, copy=False)
    squared = (a * a).sum(axis=1)[:, None] + (b * b).sum(axis=1)[None, :] - 2 * (a @ b.T)  # (N, M)
    np.maximum(squared, 0, out=squared)
    return squared if metric == "hamming" else np.sqrt(squared)


def nearest(
    queries: Descriptors, candidates: Descriptors, metric: Metric
) -> tuple[IntArray, BoolArray]:
    """Return the nearest candidate of each query, and whether the choice means anything.

    Args:
        queries: (N, D) descriptors.
        candidates: (M, D) descriptors, M >= 1.
        metric: Distance.

    Returns:
        The row of the nearest candidate, int64 (N,), the first one among equals; and bool
        (N,), False where all candidates are equally far (a blank image, a single candidate).
    """
    row = np.zeros(len(queries), dtype=np.int64)
    decided = np.zeros(len(queries), dtype=np.bool_)
    for start in range(0, len(queries), ROWS_AT_ONCE):
        part = slice(start, start + ROWS_AT_ONCE)
        distance = distances(queries[part], candidates, metric)  # (<= ROWS_AT_ONCE, M)
        row[part] = distance.argmin(axis=1)
        decided[part] = distance.min(axis=1) < distance.max(axis=1)
    return row, decided


def ratio_test(
    a: Descriptors, b: Descriptors, metric: Metric, ratio: float
) -> tuple[IntArray, IntArray, Float32Array]:
    """Match by Lowe's ratio test (IJCV 2004, section 7.1).

    A descriptor of `a` is matched to its nearest of `b` where the nearest distance is below
    `ratio` times the second nearest. With fewer than two candidates there is no second
    nearest, hence no match.

    Args:
        a: (N, D) descriptors of the source.
        b: (M, D) descriptors of the target.
        metric: Distance.
        ratio: Threshold, in (0, 1].

    Returns:
        Rows of `a` and rows of `b` of the K matches, int64 (K,) each, ascending in `a`; and
        their score, float32 (K,): 1 - nearest / second nearest.
    """
    none = np.zeros(0, dtype=np.int64)
    if len(a) == 0 or len(b) < 2:
        return none, none, np.zeros(0, dtype=np.float32)
    rows_a, rows_b, scores = [none], [none], [np.zeros(0, dtype=np.float32)]
    for start in range(0, len(a), ROWS_AT_ONCE):
        distance = distances(a[start : start + ROWS_AT_ONCE], b, metric)
        best = distance.argmin(axis=1)  # the first one among equals
        row = np.arange(len(distance))
        first = distance[row, best]
        distance[row, best] = np.inf
        second = distance.min(axis=1)
        kept = np.nonzero(first < np.float32(ratio) * second)[0]
        rows_a.append(kept + start)
        rows_b.append(best[kept])
        scores.append(1 - first[kept] / second[kept])
    return np.concatenate(rows_a), np.concatenate(rows_b), np.concatenate(scores)
