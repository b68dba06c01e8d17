"""Where along the rope a trace is, where the camera does not look straight down.

Seen at an angle, a rope that runs away from the camera looks shorter than one that runs across the
image, so equal lengths in the image are not equal lengths of rope. Given what is seen along a trace,
the arc length that each station shows is found by dynamic programming (Viterbi): it grows from 0 to 1
at a rate that changes seldom.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from pliant.baselines.tracing.depth_in_mask import FloatArray
from pliant.baselines.tracing.hypotheses import Likelihood, Trace

_STATIONS: Final = 61
_ADVANCES: Final = np.arange(2, 17)  # eighths of the mean: rates from 1/4 to 2
_LENGTH: Final = 8 * (_STATIONS - 1)
_CHANGE: Final = 0.15
_WEIGHT: Final = 1.0


def respaced(trace: Trace, likelihood: Likelihood) -> Trace:
    """Return a trace whose stations are evenly spaced on the rope instead of in the image.

    Args:
        trace: The trace.
        likelihood: What is seen at places of the image says of where along the rope they are.
    """
    at = np.linspace(0, len(trace.uv_px) - 1, _STATIONS)
    number = np.arange(len(trace.uv_px))
    places = _at(trace.uv_px, at, number)
    log_likelihood = np.log(likelihood(places))  # (_STATIONS, STEPS)
    share = _most_likely(log_likelihood)
    wanted = np.interp(np.linspace(0, 1, len(number)), share, at)
    return replace(trace, uv_px=_at(trace.uv_px, wanted, number))


def _at(uv_px: FloatArray, at: FloatArray, number: FloatArray) -> FloatArray:
    return np.stack([np.interp(at, number, uv_px[:, axis]) for axis in (0, 1)], axis=1)


def _most_likely(log_likelihood: FloatArray) -> FloatArray:
    """Return the share of the rope's length at each station, float64 (_STATIONS,), 0 to 1.

    Args:
        log_likelihood: float64 (_STATIONS, STEPS), of each step along the rope.
    """
    steps = log_likelihood.shape[1]
    position = (np.arange(_LENGTH + 1) / _LENGTH * steps - 0.5).clip(0, steps - 1)
    seen = _WEIGHT * np.stack(
        [np.interp(position, np.arange(steps), row) for row in log_likelihood]
    )
    change = _CHANGE * np.abs(_ADVANCES[:, None] - _ADVANCES[None])
    score = np.full((_LENGTH + 1, len(_ADVANCES)), -np.inf)
    score[0] = seen[0, 0]
    came = np.empty((_STATIONS, *score.shape), dtype=np.int8)
    for station in range(1, _STATIONS):
        options = score[:, :, None] - change  # (position, advance before, advance now)
        came[station] = options.argmax(axis=1)
        best = options.max(axis=1)
        score = np.full_like(score, -np.inf)
        for k, advance in enumerate(_ADVANCES):
            score[advance:, k] = best[:-advance, k]
        score += seen[station][:, None]
    place, rate = _LENGTH, int(score[-1].argmax())
    found = [place]
    for station in range(_STATIONS - 1, 0, -1):
        place -= int(_ADVANCES[rate])
        rate = int(came[station, place, rate])
        found.append(place)
    return np.array(found[::-1]) / _LENGTH
