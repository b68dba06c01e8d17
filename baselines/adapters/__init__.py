"""Adapters from functions, flow, warps, descriptors, matches and trackers to matchers."""

from pliant.baselines.adapters.complete import MatchFunction, as_matcher, from_function
from pliant.baselines.adapters.dense import from_flow, from_warp
from pliant.baselines.adapters.descriptors import from_descriptors
from pliant.baselines.adapters.images import Images
from pliant.baselines.adapters.sparse import from_sparse
from pliant.baselines.adapters.trackers import from_tracker

__all__ = [
    "Images",
    "MatchFunction",
    "as_matcher",
    "from_descriptors",
    "from_flow",
    "from_function",
    "from_sparse",
    "from_tracker",
    "from_warp",
]
