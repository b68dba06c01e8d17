"""Intermediate results of the matcher: before and after the choice of a distribution."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from pliant.baselines.tracing import Reframed
from pliant.models.don.certainty import Calibration
from pliant.models.don.comparison import Comparison
from pliant.models.don.tracing import TracedPlaces
from pliant.spec.arrays import FloatArray


@dataclass(frozen=True)
class Search(Comparison):
    """The probabilities of N queries, before a distribution is chosen.

    Attributes:
        traced: Where a rope's traces carry the queries, or None. They are weighed into `log_p`.
        deciding: float (N, M), what the answers are read from: `log_p`, or one way along a rope
            where `log_p` is the mean of both, or one side of a cloth.
    """

    traced: TracedPlaces | None
    deciding: torch.Tensor

    @property
    def either_way(self) -> bool:
        """Whether they are on a rope whose ends look alike."""
        return self.traced is not None and self.traced.reversed_px is not None


@dataclass(frozen=True)
class PairDistribution:
    """The distribution over the target that answers, σ, heat map and confidence are computed from.

    Attributes:
        source, target: The views as they are answered in.
        found: What was found in them.
        calibration: What holds for them, or None for a network without one.
        position_px: float64 (N, 2), the answers, in pixels of the target as seen.
    """

    source: Reframed
    target: Reframed
    found: Search
    calibration: Calibration | None
    position_px: FloatArray
