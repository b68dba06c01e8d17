"""How much a query and its two pictures are like what a network was trained on.

Statistics of a query that are larger the stranger it is are compared with those of the validation
split, whose pictures look like the training split's. The score is the share of
validation queries that are at least as unusual: uniform between 0 and 1 on such pictures, 0 on what
is stranger than all of them. (Conformal p-value: Vovk et al., *Algorithmic Learning in a Random
World*, 2005, section 2.2; the smallest of several is calibrated again.)

The statistics depend on how the answer is computed. A network that answers by descriptors alone is
unreliable where they differ from those of the training split. An answer from traces is unreliable
if the mask is not that of one rope, if no reading covers it, or if equally good readings map the
query to another position; the appearance of the rope hardly matters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np

from pliant.models.don.described import DescribedView
from pliant.models.don.tracing import TracedPlaces, TracedView
from pliant.spec.arrays import Float32Array, FloatArray
from pliant.spec.errors import TrainingError

_RIDGE: Final = 1e-3
_USUAL_SHARE: Final = float(np.log(3))  # an object three times as large, or a third, is usual
_OBJECT_PIXELS: Final = 2000  # of a picture, at most, for the covariance
_MARGIN: Final = 6.0  # standard deviations of a traced place: nearer ones agree

TRACED: Final = ("parts", "ends", "ball", "uncovered", "retraced", "stout", "length", "elsewhere")
"""What `traced_statistics` returns: parts and loose ends of the mask; a ball in it; share of it
that the best reading leaves out; share of that reading which runs along itself; its width over its
length; ratio of both views' lengths in widths; weight of the readings that answer elsewhere."""


def traced_statistics(
    source: TracedView, target: TracedView, places: TracedPlaces | None, answers_px: FloatArray
) -> FloatArray:
    """Return the statistics of answers that traces carry, float64 (N, 8), as `TRACED` names them.

    Args:
        source: The queries' view.
        target: The other view.
        places: Where the traces carry the queries, None where a view has no trace.
        answers_px: float64 (N, 2), in pixels of the target.
    """
    found = np.full((len(answers_px), len(TRACED)), np.inf)
    if places is None:
        return found
    own, slender = [], []
    for view in (source, target):
        best = view.traces[0]
        slender.append(float(np.log(best.length_px / best.half_px)))
        shape = view.shape
        own.append(
            (
                shape.parts,
                shape.ends,
                float(shape.has_ball),
                1 - best.coverage,
                best.retraced,
                -slender[-1],
            )
        )
    found[:, :6] = np.max(own, axis=0)
    found[:, 6] = abs(slender[0] - slender[1])
    found[:, 7] = 1 - places.share_within(answers_px, _MARGIN * places.sigma_px)
    return found


@dataclass(frozen=True)
class QueryDescriptors:
    """Some queries between two pictures.

    Attributes:
        source, target: The pictures.
        query: float32 (N, D), descriptors at the queries.
        distance: float64 (N,), distance of the best candidate.
    """

    source: DescribedView
    target: DescribedView
    query: Float32Array
    distance: FloatArray


@dataclass(frozen=True)
class DescriptorStatistics:
    """The descriptors of objects in the validation split.

    Attributes:
        mean: float64 (D,).
        precision: float64 (D, D), inverse of their covariance.
        log_share: Median logarithm of the object's share of a picture.
    """

    mean: FloatArray
    precision: FloatArray
    log_share: float

    STATISTICS: ClassVar = ("query", "distance", "source", "target", "share")

    @classmethod
    def of(cls, validation: Sequence[QueryDescriptors]) -> DescriptorStatistics:
        """Return those of queries of pairs of the validation split, with masks where there are."""
        pictures = [picture for asked in validation for picture in (asked.source, asked.target)]
        sampled = []
        for picture in pictures:
            rows = picture.on_object()
            sampled.append(rows[:: max(1, len(rows) // _OBJECT_PIXELS)])
        descriptors = np.concatenate(sampled).astype(np.float64)
        covariance = np.atleast_2d(np.cov(descriptors.T))
        ridge = _RIDGE * max(float(np.trace(covariance)) / len(covariance), 1e-12)
        shares = [float(p.mask.mean()) for p in pictures if p.mask is not None]
        return cls(
            mean=descriptors.mean(axis=0),
            precision=np.linalg.inv(covariance + ridge * np.eye(len(covariance))),
            log_share=float(np.median(np.log(np.maximum(shares, 1e-6)))) if shares else 0.0,
        )

    def statistics(self, asked: QueryDescriptors) -> FloatArray:
        """Return float64 (N, 5), NaN where it cannot be known.

        They are the squared Mahalanobis distance of the query's descriptor, the logarithm of the
        distance of the best candidate, the mean squared Mahalanobis distance on the object of the
        source and of the target, and how far the object's share of a picture is from the usual one,
        beyond a factor of 3.
        """
        found = np.full((len(asked.query), len(self.STATISTICS)), np.nan)
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

    def _mahalanobis(self, descriptors: Float32Array) -> FloatArray:
        gap = descriptors.astype(np.float64) - self.mean
        return np.asarray(np.einsum("ij,jk,ik->i", gap, self.precision, gap))

    def as_document(self) -> dict[str, Any]:
        """Return it as a JSON object."""
        return {
            "mean": self.mean.tolist(),
            "precision": self.precision.tolist(),
            "log_share": self.log_share,
        }

    @classmethod
    def from_document(cls, document: Any) -> DescriptorStatistics:
        """Read what `as_document` returned.

        Raises:
            KeyError, TypeError, ValueError: It is damaged.
        """
        mean, precision = (np.array(document[name], np.float64) for name in ("mean", "precision"))
        if precision.shape != (len(mean), len(mean)):
            raise ValueError(f"shapes {mean.shape}, {precision.shape}")
        return cls(mean, precision, float(document["log_share"]))


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
