"""Symmetry-aware errors: the ends of a rope may be swapped, a cloth may be rotated."""

from __future__ import annotations

import numpy as np

from pliant.evaluator.metrics.base import Groups, Metric, NoSettings, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.errors import squared_error_px2, sum_by_pair
from pliant.spec.arrays import BoolArray, FloatArray, IntArray, RealArray


class Symmetry(Metric[NoSettings]):
    """Symmetry-aware RMSE by pair and by point, and flip rates."""

    truth_columns = ("alternatives",)

    def update(self, block: Block) -> None:
        """Take in one block."""
        partners = block.partners
        if partners is None:
            return
        pairs = len(block.starts) - 1
        pair_squared, point_squared = block.pair_squared_px2.copy(), block.pair_squared_px2.copy()
        flipped_pairs, flipped_points = np.zeros(pairs), np.zeros(pairs)
        asked = np.zeros(pairs)
        lost = block.sum_by_pair(block.lost & block.counted)  # a missing answer is flipped
        # Pairs of one tier share their number of symmetries.
        symmetries = np.diff(partners.begin)[block.starts[:-1]]
        for count in np.unique(symmetries[symmetries > 0]).tolist():
            chosen = np.flatnonzero(symmetries == count)
            size = np.diff(block.starts)[chosen]
            begin = np.cumsum(size) - size
            rows: BoolArray | slice = slice(None)
            of_rows: BoolArray | slice = slice(None)
            if len(chosen) < pairs:
                rows = np.repeat(symmetries == count, np.diff(block.starts))
                of_rows = np.repeat(rows, np.diff(partners.begin))
            shape = (int(size.sum()), count)
            pair_squared[chosen], pair_flipped, nearest, point_flipped = symmetric_errors(
                block.answer_px[rows], block.squared_px2[rows],
                partners.uv_px[of_rows].reshape(*shape, 2),
                partners.visible[of_rows].reshape(shape), block.counted[rows], begin,
            )  # fmt: skip
            point_squared[chosen] = sum_by_pair(nearest, begin)
            flipped_pairs[chosen] = pair_flipped | (lost[chosen] > 0)
            flipped_points[chosen] = sum_by_pair(point_flipped, begin) + lost[chosen]
            asked[chosen] = block.pair_counted[chosen]
        put = self.table.put
        put("symmetric_squared_px2", block.pairs, pair_squared)
        put("point_symmetric_squared_px2", block.pairs, point_squared)
        put("flipped_pairs", block.pairs, flipped_pairs)
        put("symmetric_pairs", block.pairs, asked > 0)
        put("flipped_points", block.pairs, flipped_points)
        put("symmetric_points", block.pairs, asked)

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Say where flips are not defined."""
        tiers = self.context.dataset.tiers
        without = [name for name in groups.names[1:] if not tiers[name].symmetries]
        if without:
            summary.notes["flip_rate"] = f"tiers without symmetries: {', '.join(without)}"


def symmetric_errors(
    predicted_px: RealArray,
    own_squared_px2: FloatArray,
    partner_px: FloatArray,
    partner_visible: BoolArray,
    counted: BoolArray,
    starts: IntArray,
) -> tuple[FloatArray, BoolArray, FloatArray, BoolArray]:
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
        pair_squared_px2: float64 (P,), the sum over a pair's counted queries under the one
            symmetry that is best for the whole pair.
        pair_flipped: bool (P,), whether that symmetry is another than the identity.
        point_squared_px2: float64 (N,), for each query under the symmetry best for it alone.
        point_flipped: bool (N,), whether a partner is strictly nearer than the point itself.
            Rows that are not counted hold 0 and False.
    """
    own = np.where(counted, own_squared_px2, 0.0)
    first = best = sum_by_pair(own, starts)
    nearest = np.full(len(own), np.inf)
    for slot in range(partner_px.shape[1]):
        squared = squared_error_px2(predicted_px, partner_px[:, slot])
        squared[~np.isfinite(squared)] = np.inf  # behind the camera: nowhere in the image plane
        squared[~counted] = 0.0
        best = np.minimum(best, sum_by_pair(squared, starts))
        nearest = np.where(partner_visible[:, slot], np.minimum(nearest, squared), nearest)
    flipped = counted & (nearest < own)
    return best, best < first, np.where(flipped, nearest, own), flipped
