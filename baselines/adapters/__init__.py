"""Matchers made of what users have: functions, flow, warps, descriptors, matches, trackers."""

from pliant.baselines.adapters.complete import as_matcher
from pliant.baselines.adapters.functions import MatchFunction, from_function
from pliant.baselines.adapters.images import Images
from pliant.baselines.adapters.sparse import from_sparse

__all__ = ["Images", "MatchFunction", "as_matcher", "from_function", "from_sparse"]
