"""Checks of a rope that share no code with the generator: plain numpy, brute force."""

from __future__ import annotations

import numpy as np

from pliant.spec.arrays import FloatArray


def closest_stretches(points: FloatArray, apart_m: float) -> float:
    """Return the least distance of stretches with at least `apart_m` of curve between them.

    Every segment is sampled at 3 places and all pairs of samples are measured: never less than
    the true distance, and more by at most the square of a sample step over twice the distance.
    """
    steps = np.diff(points, axis=0)
    fine = np.stack([points[:-1] + t / 3 * steps for t in range(3)], axis=1).reshape(-1, 3)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    best = np.inf
    for i in range(len(fine)):
        far = np.searchsorted(length, length[i] + apart_m)
        if far < len(fine):
            gap = fine[far:] - fine[i]
            best = min(best, float(np.einsum("nk,nk->n", gap, gap).min()))
    return float(np.sqrt(best))


def signed_crossings(points: FloatArray) -> list[tuple[float, float, int]]:
    """Return (position over, position under, sign) of each crossing seen from above."""
    found = []
    step = np.diff(points, axis=0)
    for i in range(len(step) - 2):
        j = np.arange(i + 2, len(step))
        r = points[j] - points[i]
        det = step[i, 0] * step[j, 1] - step[i, 1] * step[j, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (r[:, 0] * step[j, 1] - r[:, 1] * step[j, 0]) / det
            t = (r[:, 0] * step[i, 1] - r[:, 1] * step[i, 0]) / det
        for k in np.flatnonzero((det != 0) & (s >= 0) & (s < 1) & (t >= 0) & (t < 1)):
            z_i = points[i, 2] + s[k] * step[i, 2]
            z_j = points[j[k], 2] + t[k] * step[j[k], 2]
            places = (i + s[k], j[k] + t[k])
            sign = 1 if det[k] > 0 else -1
            if z_i > z_j:
                found.append((*places, sign))
            else:
                found.append((*places[::-1], -sign))
    return found


def knot_determinant(points: FloatArray) -> int:
    """Return the determinant of the knot made by closing a curve above everything.

    |Alexander polynomial at -1|: 1 for the unknot, 3 for the trefoil, 5 for the figure-eight.
    Each crossing gives the row 2 over - under - under of arcs; any minor is the answer.
    """
    high = points[:, 2].max() + 1.0
    ends = points[[-1, 0]] * [1.0, 1.0, 0.0] + [0.0, 0.0, high]
    # A corner between the ends keeps the closing arc from lying exactly above a stretch.
    middle = ends.mean(axis=0) + np.array([0.0123, 0.0071, 0.5])
    closed = np.concatenate([points, ends[:1], middle[None], ends[1:], points[:1]])
    crossing = signed_crossings(closed)
    unders = sorted(under for _, under, _ in crossing)
    if len(unders) < 2:
        return 1
    arcs = len(unders)
    matrix = np.zeros((arcs, arcs))
    for row, (over, under, _) in enumerate(crossing):
        matrix[row, np.searchsorted(unders, over) % arcs] += 2
        before = unders.index(under)
        matrix[row, before] -= 1
        matrix[row, (before + 1) % arcs] -= 1
    return round(abs(float(np.linalg.det(matrix[:-1, :-1]))))
