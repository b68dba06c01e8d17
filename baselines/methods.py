"""The methods that need no training, by name."""

from __future__ import annotations

from collections.abc import Callable

from pliant.baselines.controls import Identity, MaskCentroid, Oracle, RandomInMask
from pliant.baselines.features.orb import orb
from pliant.baselines.features.sift import sift
from pliant.baselines.features.surf import surf
from pliant.baselines.matcher import Matcher, SplitMatcher
from pliant.baselines.tracing import RopeTracer

METHODS: dict[str, Callable[[], Matcher | SplitMatcher]] = {
    "sift": sift,
    "surf": surf,
    "orb": orb,
    "rope-tracer": RopeTracer,
    "identity": Identity,
    "random": RandomInMask,
    "centroid": MaskCentroid,
    "oracle": Oracle,
}
"""Name -> what makes the method. SIFT, SURF and ORB raise `MissingExtraError` when they are
made without their libraries."""
