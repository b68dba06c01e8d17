"""Which two sequences every image pair crosses, and the effects of sequences on pairs.

A pair asks points of one sequence in another, so it errs with both. Only sequences are
independent: two pairs that share a sequence, as source or as target, are not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pliant.spec.arrays import BoolArray, FloatArray, IndexArray, IntArray

_TOLERANCE: Final = 1e-10
_DENSE: Final = 32
"""Up to so many sequences the effects are fitted with a dense matrix."""


@dataclass(frozen=True)
class Crossing:
    """The couples of sequences that the pairs of a split cross.

    A couple is a source and a target sequence; the pairs of a couple are summed up at once. Within
    an episode both are the same sequence.

    Attributes:
        couple: int64 (P,), the couple of each pair, 0 to E - 1.
        source, target: int64 (E,), the sequences of each couple, 0 to C - 1.
        tier: int64 (C,), the tier of each sequence.
        tiers: Number of tiers, T.
    """

    couple: IntArray
    source: IntArray
    target: IntArray
    tier: IntArray
    tiers: int

    @classmethod
    def of(
        cls, sequence_a: IndexArray, sequence_b: IndexArray, tier: IndexArray, tiers: int
    ) -> Crossing:
        """Number the sequences and the couples that occur.

        Args:
            sequence_a: integer (P,), code of each pair's source sequence.
            sequence_b: integer (P,), code of its target sequence.
            tier: integer (P,), code of its tier.
            tiers: Number of tiers.
        """
        both = np.concatenate([sequence_a, sequence_b])
        _, first, number = np.unique(both, return_index=True, return_inverse=True)
        ends = number.reshape(2, -1)  # (2, P)
        couples, couple = np.unique(ends, axis=1, return_inverse=True)
        of_sequence = np.concatenate([tier, tier])[first].astype(np.int64)
        return cls(couple.reshape(-1), couples[0], couples[1], of_sequence, tiers)

    def sizes(self, counted: BoolArray | slice = slice(None)) -> IntArray:
        """Return the number of sequences of each tier, int64 (T,); `counted` may choose some."""
        return np.bincount(self.tier[counted], minlength=self.tiers)

    def extent(self, group: int, counted: BoolArray | slice = slice(None)) -> tuple[int, int]:
        """Return (sequences, tiers) of the whole split for 0, of tier `group` - 1 otherwise."""
        sizes = self.sizes(counted)
        if group == 0:
            return int(sizes.sum()), int((sizes > 0).sum())
        return int(sizes[group - 1]), 1

    def of_group(self, group: int) -> BoolArray:
        """Return which couples are in the whole split (0) or in tier `group` - 1, bool (E,)."""
        found: BoolArray = (self.tier[self.source] == group - 1) | (group == 0)
        return found

    def sum(self, values: FloatArray) -> FloatArray:
        """Sum values of pairs, float64 (P,), over each couple, float64 (E,)."""
        sums: FloatArray = np.bincount(self.couple, values, len(self.source)).astype(np.float64)
        return sums

    def weights(self, drawn: FloatArray) -> FloatArray:
        """Return how often each couple is drawn with its sequences, float64 (B, E).

        Args:
            drawn: float64 (B, C), how often each sequence is drawn.
        """
        alone = self.source == self.target
        return drawn[:, self.source] * np.where(alone, 1.0, drawn[:, self.target])

    def effects(self, values: FloatArray, weight: FloatArray) -> FloatArray:
        """Share a sum over couples out to the sequences, float64 (C,).

        Fits `values` / `weight` by the sum of an effect of the source and one of the target
        (weighted least squares). The effects of a sequence in both roles, each times its weight,
        are added; the total over all sequences is that of `values`.

        Args:
            values: float64 (E,), 0 where `weight` is.
            weight: float64 (E,), >= 0.
        """
        from scipy.sparse import csr_array
        from scipy.sparse.linalg import lsqr

        rows, count = np.arange(len(weight)), len(self.tier)
        total = self._in_roles(weight)
        # Columns of equal weight: of the solutions, which differ by a constant between the roles,
        # the shortest then gives a constant value in equal parts to both roles.
        scale = np.divide(1.0, np.sqrt(total), out=np.zeros(2 * count), where=total > 0)
        root = np.sqrt(weight)
        mean = np.divide(values, weight, out=np.zeros(len(weight)), where=weight > 0)
        places = np.concatenate([self.source, count + self.target])
        cells = np.tile(root, 2) * scale[places]
        design = csr_array((cells, (np.tile(rows, 2), places)), (len(rows), 2 * count))
        if count <= _DENSE:
            normal = (design.T @ design).toarray()
            solution = np.linalg.lstsq(normal, design.T @ (root * mean), rcond=_TOLERANCE)[0]
        else:
            solution = lsqr(design, root * mean, atol=_TOLERANCE, btol=_TOLERANCE)[0]
        shared: FloatArray = (total * scale * solution).reshape(2, count).sum(axis=0)
        return shared

    def shares(self, weight: FloatArray) -> FloatArray:
        """Return half the weight of the couples that each sequence is in, float64 (C,).

        These are the effects of `weight` itself: where all values are 1, each role has a half.
        """
        half: FloatArray = self._in_roles(weight).reshape(2, -1).sum(axis=0) / 2
        return half

    def _in_roles(self, weight: FloatArray) -> FloatArray:
        """Sum weights over the sources, then over the targets, float64 (2C,)."""
        count = len(self.tier)
        places = np.concatenate([self.source, count + self.target])
        return np.bincount(places, np.tile(weight, 2), 2 * count).astype(np.float64)
