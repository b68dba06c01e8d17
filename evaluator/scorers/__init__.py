"""Scorers: each walks the blocks once and gathers what its family of metrics needs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pliant.evaluator.scorers.analysis import AnalysisScorer
from pliant.evaluator.scorers.base import Groups, PairTable, Scorer, ScoringContext, Summary
from pliant.evaluator.scorers.continuity import ContinuityScorer
from pliant.evaluator.scorers.distribution import DistributionScorer
from pliant.evaluator.scorers.geodesic import GeodesicScorer
from pliant.evaluator.scorers.jitter import JitterScorer
from pliant.evaluator.scorers.localisation import CountScorer, LocalisationScorer
from pliant.evaluator.scorers.pck import PckScorer
from pliant.evaluator.scorers.slices import SlicesScorer
from pliant.evaluator.scorers.symmetry import SymmetryScorer
from pliant.evaluator.scorers.tapvid import TapvidScorer
from pliant.evaluator.scorers.time import TimeScorer

SCORERS: Final[dict[str, type[Scorer]]] = {
    "localisation": LocalisationScorer,
    "pck": PckScorer,
    "symmetry": SymmetryScorer,
    "tapvid": TapvidScorer,
    "geodesic": GeodesicScorer,
    "continuity": ContinuityScorer,
    "jitter": JitterScorer,
    "time": TimeScorer,
    "distribution": DistributionScorer,
    "slices": SlicesScorer,
    "analysis": AnalysisScorer,
}
"""The scorer of each family of metrics that a protocol may name."""


def scorers_of(metrics: Mapping[str, Mapping[str, Any]], context: ScoringContext) -> list[Scorer]:
    """Return the counts and the scorers of a protocol's families, in the order of `SCORERS`.

    Args:
        metrics: The `metrics` of a protocol.
        context: What is scored.
    """
    named = [kind(metrics[name], context) for name, kind in SCORERS.items() if name in metrics]
    return [CountScorer({}, context), *named]


__all__ = ["SCORERS", "Groups", "PairTable", "Scorer", "ScoringContext", "Summary", "scorers_of"]
