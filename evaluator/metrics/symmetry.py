"""Errors that forgive a symmetry of the object: a rope's ends swapped, a cloth turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.evaluator.arrays import BoolArray, FloatArray, IntArray, RealArray


@dataclass(frozen=True)
class SymmetricErrors:
    """What is left of the error once symmetries are forgiven.

    Attributes:
        pair_squared_px2: float64 (P,), the sum over a pair's counted queries under the one
            symmetry that is best for the whole pair.
        pair_flipped: bool (P,), whether that symmetry is another than the identity.
        point_squared_px2: float64 (N,), for each query under the symmetry best for it alone.
        point_flipped: bool (N,), whether a partner is strictly nearer than the point itself.
    """

    pair_squared_px2: FloatArray
    pair_flipped: BoolArray
    point_squared_px2: FloatArray
    point_flipped: BoolArray


def symmetric_errors(
    predicted_px: RealArray,
    own_squared_px2: FloatArray,
    partner_px: FloatArray,
    partner_visible: BoolArray,
    counted: BoolArray,
    starts: IntArray,
) -> SymmetricErrors:
    """Forgive symmetries, once for a whole pair and once for each point.

    For a pair every equivalent labelling of the whole object is tried, so a partner counts
    wherever it projects to; a single point may only be mistaken for a partner that can be seen.

    Args:
        predicted_px: float (N, 2), the answers.
        own_squared_px2: float64 (N,), squared error against the point itself.
        partner_px: float64 (N, S, 2), where the S partners are in the target frame.
        partner_visible: bool (N, S), whether they are visible there.
        counted: bool (N,), queries that enter the error.
        starts: int64 (P,), first row of each pair.

    Returns:
        The forgiven errors; rows that are not counted hold 0 and False.
    """
    offset = predicted_px[:, None, :].astype(np.float64) - partner_px  # (N, S, 2)
    partner = np.einsum("nsk,nsk->ns", offset, offset)
    partner[~np.isfinite(partner)] = np.inf  # behind the camera: nowhere in the image plane
    squared = np.concatenate([own_squared_px2[:, None], partner], axis=1)  # (N, S + 1)
    squared[~counted] = 0.0
    sums = np.add.reduceat(squared, starts, axis=0)  # (P, S + 1)
    best = sums.min(axis=1)
    nearest = np.where(partner_visible, squared[:, 1:], np.inf).min(axis=1, initial=np.inf)
    flipped = counted & (nearest < squared[:, 0])
    return SymmetricErrors(
        pair_squared_px2=best,
        pair_flipped=best < sums[:, 0],
        point_squared_px2=np.where(flipped, nearest, squared[:, 0]),
        point_flipped=flipped,
    )
