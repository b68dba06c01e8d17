"""How much a query and its two pictures are like what a network was trained on.

Statistics of a query that are larger the stranger it is (`strangeness.py`) are compared with those
of the validation split, whose pictures look like the training split's. The score is the share of
validation queries that are at least as unusual: uniform between 0 and 1 on such pictures, 0 on what
is stranger than all of them. (Conformal p-value: Vovk et al., *Algorithmic Learning in a Random
World*, 2005, section 2.2; the smallest of several is calibrated again.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pliant.models.don.strangeness import TRACED, DescriptorStatistics
from pliant.spec.arrays import Float32Array, FloatArray
from pliant.spec.errors import TrainingError

FAMILIARITY = "familiarity.json"
"""The file of a run that contains it."""

_TAILS = np.concatenate([np.linspace(1, 0.1, 19), np.geomspace(0.09, 0.0005, 40)])


@dataclass(frozen=True)
class Familiarity:
    """The statistics of the validation split.

    Attributes:
        thresholds: float64 (S, tails): what a statistic exceeds in a share `_TAILS` of the queries;
            the last is its maximum.
        combined: float64 (tails,): likewise for the logarithm of the smallest share, downwards.
        descriptors: Of a network that answers by descriptors alone, those of the validation split;
            None for one whose answers come from the traces of ropes.
    """

    thresholds: FloatArray
    combined: FloatArray
    descriptors: DescriptorStatistics | None = None

    def score(self, statistics: FloatArray) -> Float32Array:
        """Return the familiarity of N queries, float32 (N,), 0 to 1.

        Args:
            statistics: float64 (N, S), larger is stranger, NaN where it cannot be known.
        """
        return np.exp(_log_tail(-self._least_share(statistics), self.combined)).astype(np.float32)

    def _least_share(self, statistics: FloatArray) -> FloatArray:
        """Return the logarithm of the smallest share of a query's statistics, float64 (N,)."""
        known = np.where(np.isnan(statistics), -np.inf, statistics)
        shares = [_log_tail(*pair) for pair in zip(known.T, self.thresholds, strict=True)]
        return np.asarray(np.min(shares, axis=0))

    def as_document(self) -> dict[str, Any]:
        """Return what `familiarity.json` contains."""
        usual = self.descriptors
        return {
            "thresholds": self.thresholds.tolist(),
            "combined": self.combined.tolist(),
            "descriptors": None if usual is None else usual.as_document(),
        }

    @classmethod
    def from_document(cls, document: Any, path: object) -> Familiarity:
        """Read what `as_document` returned.

        Raises:
            TrainingError: It is damaged.
        """
        try:
            given = document["descriptors"]
            usual = None if given is None else DescriptorStatistics.from_document(given)
            thresholds, combined = (
                np.array(document[name], np.float64) for name in ("thresholds", "combined")
            )
            count = len(TRACED if usual is None else DescriptorStatistics.STATISTICS)
            if (thresholds.shape, combined.shape) != ((count, len(_TAILS)), (len(_TAILS),)):
                raise ValueError(f"shapes {thresholds.shape}, {combined.shape}")
        except (KeyError, TypeError, ValueError) as error:
            raise TrainingError(
                "the familiarity is damaged", path=path, found=str(error)[:100]
            ) from error
        return cls(thresholds, combined, usual)


def fit_familiarity(
    statistics: FloatArray, descriptors: DescriptorStatistics | None = None
) -> Familiarity:
    """Return the familiarity of a network.

    Args:
        statistics: float64 (N, S), of queries that look like the training split.
        descriptors: What the statistics are of, if they are those of descriptors.
    """
    known = np.nan_to_num(statistics, nan=-1e9, posinf=1e9)
    thresholds = np.stack([_thresholds(column) for column in known.T])
    ranked = Familiarity(thresholds, _thresholds(np.zeros(1)), descriptors)
    return replace(ranked, combined=_thresholds(-ranked._least_share(known)))


def _thresholds(values: FloatArray) -> FloatArray:
    """Return what values exceed in each share of `_TAILS`, the maximum in the last."""
    thresholds: FloatArray = np.quantile(values, 1 - _TAILS)
    thresholds[-1] = values.max()
    return np.maximum.accumulate(thresholds)


def _log_tail(values: FloatArray, thresholds: FloatArray) -> FloatArray:
    """Return the logarithm of the share of validation values at least as large; -inf beyond all."""
    above = np.searchsorted(thresholds, values)  # the first of equal thresholds: the largest share
    upper = np.clip(above, 1, len(thresholds) - 1)
    low, high = thresholds[upper - 1], thresholds[upper]
    way = (values - low) / np.maximum(high - low, 1e-30)
    tails = np.log(_TAILS)
    inside = tails[upper - 1] + np.clip(way, 0, 1) * (tails[upper] - tails[upper - 1])
    found: FloatArray = np.where(above == 0, 0.0, inside)
    return np.where(above == len(thresholds), -np.inf, found)
