"""Positions of queries from the matches around them."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from pliant.spec.arrays import FloatArray

Interpolation = Literal["nearest", "affine"]

_RIDGE: Final = 1e-3
"""Weight that pulls the local map towards a pure shift, where the matches leave it open (a line
of matches along a rope says nothing across it)."""

_REWEIGHTINGS: Final = 3
_SCALE_FLOOR_PX: Final = 0.5


def interpolate(
    uv_a_px: FloatArray,
    uv_b_px: FloatArray,
    queries_px: FloatArray,
    method: Interpolation,
    neighbours: int,
) -> FloatArray:
    """Return where queries are, given matches.

    Args:
        uv_a_px: float64 (M, 2), M >= 1, matches in the source.
        uv_b_px: float64 (M, 2), the same in the target.
        queries_px: float64 (N, 2), in the source.
        method: `nearest` moves a query as its nearest match; `affine` fits a robust affine map to
            the nearest matches.
        neighbours: Matches that `affine` fits.

    Returns:
        float64 (N, 2), in the target.
    """
    from scipy.spatial import cKDTree

    uv_a_px, first = np.unique(uv_a_px, axis=0, return_index=True)
    moved = uv_b_px[first] - uv_a_px
    count = 1 if method == "nearest" else min(neighbours, len(uv_a_px))
    if count < 2:
        nearest = cKDTree(uv_a_px).query(queries_px)[1]
        return queries_px + moved[nearest]
    distance, index = cKDTree(uv_a_px).query(queries_px, k=count)  # (N, k)
    return queries_px + _affine(uv_a_px[index] - queries_px[:, None], moved[index], distance)


def _affine(offset: FloatArray, moved: FloatArray, distance: FloatArray) -> FloatArray:
    """Return the displacement at the origin of local affine fits, by Cauchy reweighting.

    Args:
        offset: float64 (N, k, 2), matches relative to the query.
        moved: float64 (N, k, 2), their displacements.
        distance: float64 (N, k), lengths of `offset`.

    Returns:
        float64 (N, 2).
    """
    reach = np.maximum(distance[:, -1:], 1e-6)  # (N, 1)
    near = np.exp(-0.5 * (2 * distance / reach) ** 2)
    terms = np.concatenate([np.ones_like(offset[..., :1]), offset / reach[..., None]], axis=2)
    ridge = np.diag([0.0, _RIDGE, _RIDGE])
    weight, solved = near, np.zeros((len(offset), 3, 2))
    for _ in range(_REWEIGHTINGS):
        weighted = terms * weight[..., None]  # (N, k, 3)
        matrix = weighted.transpose(0, 2, 1) @ terms
        matrix += ridge * weight.sum(axis=1)[:, None, None]
        solved = np.linalg.solve(matrix, weighted.transpose(0, 2, 1) @ moved)
        residual = np.linalg.norm(moved - terms @ solved, axis=2)
        scale = np.maximum(1.5 * np.median(residual, axis=1, keepdims=True), _SCALE_FLOOR_PX)
        weight = near / (1 + (residual / scale) ** 2)
    shift: FloatArray = solved[:, 0]
    return shift
