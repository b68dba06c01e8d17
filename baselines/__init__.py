"""Classical methods and controls, and the loop that turns any matcher into a submission."""

from pliant.baselines.matcher import (
    Answers,
    Heat,
    HeatMatcher,
    KeypointMatcher,
    Matcher,
    Matches,
    SplitMatcher,
    TrackMatcher,
    View,
)
from pliant.baselines.methods import METHODS

__all__ = [
    "METHODS",
    "Answers",
    "Heat",
    "HeatMatcher",
    "KeypointMatcher",
    "Matcher",
    "Matches",
    "SplitMatcher",
    "TrackMatcher",
    "View",
]
