"""How much a query and its two pictures are like what a network was trained on.

Five statistics of a query are compared with those of the validation split, whose pictures look
like the training split's: the Mahalanobis distance of the query's descriptor from the descriptors
of objects, the distance of the best candidate, the mean Mahalanobis distance on the object of the
source and of the target, and how far the object's share of a picture is from the usual one, beyond
a factor of 3. The score is the share of validation queries that are at least as unusual: uniform
between 0 and 1 on such pictures, 0 on what is stranger than all of them. (Conformal p-value: Vovk
et al., *Algorithmic Learning in a Random World*, 2005, section 2.2; the smallest of several is
calibrated again.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.errors import TrainingError

FAMILIARITY = "familiarity.json"
"""The file of a run that contains it."""

Floats = npt.NDArray[np.float64]
_STATISTICS = 5
_RIDGE = 1e-3
_USUAL_SHARE = float(np.log(3))  # an object three times as large, or a third, is not unusual
_OBJECT_PIXELS = 2000  # of a picture, at most, for the covariance
_TAILS = np.concatenate([np.linspace(1, 0.1, 19), np.geomspace(0.09, 0.0005, 40)])


@dataclass(frozen=True)
class Described:
    """What is known of one picture.

    Attributes:
        descriptors: float32 (D, h, w).
        mask: bool (h, w), the object, or None where nobody says where it is.
    """

    descriptors: npt.NDArray[np.float32]
    mask: npt.NDArray[np.bool_] | None

    def on_object(self) -> npt.NDArray[np.float32]:
        """Return the descriptors on the object, float32 (n, D)."""
        everywhere = self.mask is None or not self.mask.any()
        flat = self.descriptors.reshape(len(self.descriptors), -1).T
        return flat if everywhere else flat[self.mask.reshape(-1)]  # type: ignore[union-attr]


@dataclass(frozen=True)
class Asked:
    """Some queries between two pictures.

    Attributes:
        source, target: The pictures.
        query: float32 (N, D), descriptors at the queries.
        distance: float64 (N,), distance of the best candidate.
    """

    source: Described
    target: Described
    query: npt.NDArray[np.float32]
    distance: Floats


@dataclass(frozen=True)
class Familiarity:
    """The statistics of the validation split.

    Attributes:
        mean: float64 (D,), of descriptors on objects.
        precision: float64 (D, D), inverse of their covariance.
        log_share: Median logarithm of the object's share of a picture.
        thresholds: float64 (statistics, tails): what a statistic exceeds in a share `_TAILS`
            of the queries; the last is its maximum.
        combined: float64 (tails,): likewise for the logarithm of the smallest share, downwards.
    """

    mean: Floats
    precision: Floats
    log_share: float
    thresholds: Floats
    combined: Floats

    def score(self, asked: Asked) -> npt.NDArray[np.float32]:
        """Return the familiarity of each query, float32 (N,), 0 to 1."""
        lowest = -self._least_share(self._statistics(asked))
        return np.exp(_log_tail(lowest, self.combined)).astype(np.float32)

    def _statistics(self, asked: Asked) -> Floats:
        """Return float64 (N, statistics), higher is stranger, NaN where it cannot be known."""
        count = len(asked.query)
        found = np.full((count, _STATISTICS), np.nan)
        found[:, 0] = self._mahalanobis(asked.query)
        found[:, 1] = np.log(np.maximum(asked.distance, 1e-12))
        odd = 0.0
        for column, picture in ((2, asked.source), (3, asked.target)):
            if picture.mask is not None:
                found[:, column] = self._mahalanobis(picture.on_object()).mean()
                share = max(float(picture.mask.mean()), 1e-6)
                odd = max(odd, abs(np.log(share) - self.log_share) - _USUAL_SHARE)
        found[:, 4] = odd
        return found

    def _mahalanobis(self, descriptors: npt.NDArray[np.float32]) -> Floats:
        gap = descriptors.astype(np.float64) - self.mean
        squared: Floats = np.einsum("ij,jk,ik->i", gap, self.precision, gap)
        return squared

    def _least_share(self, statistics: Floats) -> Floats:
        """Return the logarithm of the smallest share of a query's statistics, float64 (N,)."""
        shares = np.zeros(statistics.shape)
        for column, thresholds in enumerate(self.thresholds):
            values = np.nan_to_num(statistics[:, column], nan=-np.inf)
            shares[:, column] = _log_tail(values, thresholds)
        least: Floats = shares.min(axis=1)
        return least

    def as_document(self) -> dict[str, Any]:
        """Return what `familiarity.json` contains."""
        return {
            "mean": self.mean.tolist(),
            "precision": self.precision.tolist(),
            "log_share": self.log_share,
            "thresholds": self.thresholds.tolist(),
            "combined": self.combined.tolist(),
        }

    @classmethod
    def from_document(cls, document: Any, path: object) -> Familiarity:
        """Read what `as_document` returned.

        Raises:
            TrainingError: It is damaged.
        """
        try:
            arrays = {
                name: np.array(document[name], np.float64)
                for name in ("mean", "precision", "thresholds", "combined")
            }
            dim = len(arrays["mean"])
            shapes = [array.shape for array in arrays.values()]
            if shapes != [(dim,), (dim, dim), (_STATISTICS, len(_TAILS)), (len(_TAILS),)]:
                raise ValueError(f"shapes {shapes}")
            return cls(log_share=float(document["log_share"]), **arrays)
        except (KeyError, TypeError, ValueError) as error:
            raise TrainingError(
                "the familiarity is damaged", path=path, found=str(error)[:100]
            ) from error


def fit_familiarity(validation: Sequence[Asked]) -> Familiarity:
    """Return the statistics of queries that look like the training split.

    Args:
        validation: Queries of pairs of the validation split, with masks where the run has them.
    """
    pictures = [picture for asked in validation for picture in (asked.source, asked.target)]
    sampled = []
    for picture in pictures:
        rows = picture.on_object()
        sampled.append(rows[:: max(1, len(rows) // _OBJECT_PIXELS)])
    descriptors = np.concatenate(sampled).astype(np.float64)
    covariance = np.atleast_2d(np.cov(descriptors.T))
    ridge = _RIDGE * max(float(np.trace(covariance)) / len(covariance), 1e-12)
    shares = [float(p.mask.mean()) for p in pictures if p.mask is not None]
    empty = np.zeros((_STATISTICS, len(_TAILS)))
    start = Familiarity(
        mean=descriptors.mean(axis=0),
        precision=np.linalg.inv(covariance + ridge * np.eye(len(covariance))),
        log_share=float(np.median(np.log(np.maximum(shares, 1e-6)))) if shares else 0.0,
        thresholds=empty,
        combined=empty[0],
    )
    found = np.concatenate([start._statistics(asked) for asked in validation])
    found = np.nan_to_num(found, nan=-1e9)
    thresholds = np.stack([_thresholds(column) for column in found.T])
    ranked = Familiarity(
        start.mean, start.precision, start.log_share, thresholds, _thresholds(np.zeros(1))
    )
    combined = _thresholds(-ranked._least_share(found))
    return Familiarity(start.mean, start.precision, start.log_share, thresholds, combined)


def _thresholds(values: Floats) -> Floats:
    """Return what values exceed in each share of `_TAILS`, the maximum in the last."""
    thresholds: Floats = np.quantile(values, 1 - _TAILS)
    thresholds[-1] = values.max()
    return np.maximum.accumulate(thresholds)


def _log_tail(values: Floats, thresholds: Floats) -> Floats:
    """Return the logarithm of the share of validation values at least as large; -inf beyond all."""
    above = np.searchsorted(thresholds, values)  # the first of equal thresholds: the largest share
    upper = np.clip(above, 1, len(thresholds) - 1)
    low, high = thresholds[upper - 1], thresholds[upper]
    way = (values - low) / np.maximum(high - low, 1e-300)
    tails = np.log(_TAILS)
    inside = tails[upper - 1] + np.clip(way, 0, 1) * (tails[upper] - tails[upper - 1])
    found: Floats = np.where(above == 0, 0.0, inside)
    return np.where(above == len(thresholds), -np.inf, found)
