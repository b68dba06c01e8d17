"""Carrying places from a trace in one image to a trace in another: same arc length, same side.

A rope does not roll on its table, but a camera sees it in a direction that leans by
l = atan(n (x - x_0) / f) across it and by t (x - x_0) / f along it, with t and n the directions
along and across in the image, and x_0 where the camera looks straight down. A place at the offset o
from the middle of a rope of half width h is at the angle a = asin(o / h) - l from its highest line.
Another image shows that angle at the offset h' sin(a + l'). Each image shows the place
h cos(a) t (x - x_0) / f further along than the middle, which is lower.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.baselines.tracing.crossings import nearest_stations
from pliant.baselines.tracing.hypotheses import Trace
from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray


@dataclass(frozen=True)
class Located:
    """Where N places are along and across a trace.

    Attributes:
        station: int64 (N,), the station that each belongs to.
        along: float64 (N,), from there along the trace, as shares of its length.
        angle: float64 (N,), around the rope from its highest line, radians.
        beyond: float64 (N,), how far a place is off the rope's body, in half widths.
    """

    station: npt.NDArray[np.int64]
    along: FloatArray
    angle: FloatArray
    beyond: FloatArray


def located(trace: Trace, uv_px: npt.NDArray[np.floating[Any]]) -> Located:
    """Return where places are along a trace: at the nearest station, or at the one that covers it.

    Args:
        trace: The trace in the places' image.
        uv_px: float (N, 2).
    """
    gap = np.linalg.norm(uv_px[:, None] - trace.uv_px[None], axis=2)
    station = nearest_stations(gap, uv_px, trace.overlaps)
    axes = trace.axes[station]
    along, across = np.einsum("nij,nj->in", axes, uv_px - trace.uv_px[station])
    on_body = (across / trace.half_px).clip(-1, 1)
    angle = np.arcsin(on_body) - np.arctan(trace.sight[station, 1])
    along -= _parallax_px(trace, station, angle)
    return Located(station, along / trace.length_px, angle, across / trace.half_px - on_body)


def placed(trace: Trace, places: Located) -> FloatArray:
    """Return where places are on another trace, float64 (N, 2): at the same share of its length.

    Args:
        trace: A trace, in any image.
        places: Where they are along it.
    """
    station = places.station
    seen = (places.angle + np.arctan(trace.sight[station, 1])).clip(-np.pi / 2, np.pi / 2)
    along = places.along * trace.length_px + _parallax_px(trace, station, places.angle)
    across = (np.sin(seen) + places.beyond) * trace.half_px
    offset = np.stack([along, across], axis=1)
    moved = np.einsum("nij,ni->nj", trace.axes[station], offset)
    return np.asarray(trace.uv_px[station] + moved)


def _parallax_px(trace: Trace, station: npt.NDArray[np.int64], angle: FloatArray) -> FloatArray:
    """Return how much further along than the middle below them places appear, float64 (N,)."""
    return np.asarray(trace.half_px * np.cos(angle) * trace.sight[station, 0])


def pair_log_odds(source: Sequence[Trace], target: Sequence[Trace]) -> FloatArray:
    """Return what T and U traces say themselves for each pair being right, float64 (T, U).

    It is 30 (q + q') - |log(l / l')|, with q the score and l the length of either trace.

    Args:
        source: Traces in one image.
        target: Traces in the other.
    """
    scores = np.add.outer([each.score for each in source], [each.score for each in target])
    longer = np.subtract.outer(
        np.log([each.length_px for each in source]), np.log([each.length_px for each in target])
    )
    return np.asarray(TRACING.coverage_weight * scores - np.abs(longer))


def best_pair(source: Sequence[Trace], target: Sequence[Trace]) -> tuple[Trace, Trace]:
    """Return the traces that fit together best: both plausible, and of one length."""
    a, b = divmod(int(pair_log_odds(source, target).argmax()), len(target))
    return source[a], target[b]
