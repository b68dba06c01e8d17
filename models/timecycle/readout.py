"""Choosing how an encoder's descriptors are read when points are carried.

A prior, a temperature and a memory that suit one encoder spoil another: descriptors that separate
well want a sharp softmax and a loose prior, poor ones the opposite. Encoders are compared fairly
when each is read in the way that suits it, chosen on the same validation stretches.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Final

from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.settings import PropagationSettings
from pliant.models.timecycle.validation import Stretch, errors_over_time, figures, track_with

TRIED: Final[dict[str, tuple[float, ...]]] = {
    "prior": (0.7, 1.5, 3.0),
    "temperature": (0.01, 0.03, 0.1),
    "first_weight": (0.0, 0.25, 1.0),
}
"""What is tried; `prior` in fortieths of the picture's width."""


def choose_readout(matcher: TimeCycleMatcher, stretches: Sequence[Stretch]) -> PropagationSettings:
    """Return the settings with the lowest error late in the stretches.

    Args:
        matcher: The matcher; its own settings give what is not tried.
        stretches: Validation stretches.
    """
    own = matcher.settings.propagation
    names = list(TRIED)
    tried = [
        own.replace(**dict(zip(names, values, strict=True)))
        for values in itertools.product(*TRIED.values())
    ]
    cells = matcher.settings.width / 40 / own.stride
    tried = [each.replace(prior=each.prior * cells) for each in tried]
    return min(tried, key=lambda each: _error(matcher.read_by(each), stretches))


def _error(matcher: TimeCycleMatcher, stretches: Sequence[Stretch]) -> float:
    return figures(errors_over_time(track_with(matcher), stretches))["criterion_px"]
