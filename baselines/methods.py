"""The methods that need no training, by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from pliant.baselines.controls import Identity, MaskCentroid, Oracle, RandomInMask
from pliant.baselines.features.local_features import LocalFeatureMatcher, LocalFeatures
from pliant.baselines.features.opencv_features import Orb, Sift
from pliant.baselines.features.surf import MahotasSurf
from pliant.baselines.flow import FlowChain
from pliant.baselines.matcher import Matcher, SplitMatcher
from pliant.baselines.outline import ClothOutline

Make = Callable[[], Matcher | SplitMatcher]


_FEATURES: Final[dict[str, Callable[[], LocalFeatures]]] = {
    "sift": Sift,
    "surf": MahotasSurf,
    "orb": Orb,
}


def local_feature(name: str) -> LocalFeatureMatcher:
    """Return the method of a local feature.

    Args:
        name: `sift`, `surf` or `orb`.

    Raises:
        MissingExtraError: Its library is not installed.
    """
    return LocalFeatureMatcher(_FEATURES[name]())


def rope_tracer() -> Matcher:
    """Follows the rope through both masks, and answers at the same arc length and side."""
    from pliant.baselines.tracing import RopeTracer  # SciPy's modules, which take 0.15 s to load

    return RopeTracer()


def _named(make: Callable[[str], Matcher], about: dict[str, str]) -> dict[str, Make]:
    """Return what makes each method, with its description as the docstring."""
    made: dict[str, Make] = {}
    for name, text in about.items():
        of_name = partial(make, name)
        of_name.__doc__ = text
        made[name] = of_name
    return made


METHODS: dict[str, Make] = {
    **_named(
        local_feature,
        {
            "sift": "Local feature SIFT (Lowe, 2004), by OpenCV.",
            "surf": "Local feature SURF (Bay et al., 2008), by mahotas.",
            "orb": "Local feature ORB (Rublee et al., 2011), by OpenCV.",
        },
    ),
    **_named(
        FlowChain,
        {
            "lk-chain": "Lucas-Kanade optical flow chained through the frames of an episode.",
            "dis-chain": "Dense inverse search (Kroeger et al., 2016), chained likewise.",
        },
    ),
    "cloth-tps": ClothOutline,
    "rope-tracer": rope_tracer,
    "identity": Identity,
    "random": RandomInMask,
    "centroid": MaskCentroid,
    "oracle": Oracle,
}
"""Name -> what makes the method. Those of OpenCV raise `MissingExtraError` when they are made
without it."""
