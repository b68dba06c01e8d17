"""Classical methods and controls, and the loop that turns any matcher into a submission."""

from pliant.baselines.matcher import (
    Heat,
    HeatMatcher,
    KeypointMatcher,
    Matcher,
    SharingMatcher,
    SplitMatcher,
    TrackMatcher,
)
from pliant.baselines.methods import METHODS
from pliant.spec.answers import Answers, Matches
from pliant.spec.frame import Frame, Pair

__all__ = [
    "METHODS",
    "Answers",
    "Frame",
    "Heat",
    "HeatMatcher",
    "KeypointMatcher",
    "Matcher",
    "Matches",
    "Pair",
    "SharingMatcher",
    "SplitMatcher",
    "TrackMatcher",
]
