"""Carrying places from a trace in one image to a trace in another: same arc length, same side."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.baselines.tracing.crossings import nearest_stations
from pliant.baselines.tracing.depth_in_mask import FloatArray
from pliant.baselines.tracing.hypotheses import Trace


@dataclass(frozen=True)
class Located:
    """Where N places are along and across a trace.

    Attributes:
        station: int64 (N,), the station that each belongs to.
        offset: float64 (N, 2), from there along and across the trace, as shares of its length.
    """

    station: npt.NDArray[np.int64]
    offset: FloatArray


def located(trace: Trace, uv_px: npt.NDArray[np.floating[Any]]) -> Located:
    """Return where places are along a trace: at the nearest station, or at the one that covers it.

    Args:
        trace: The trace in the places' image.
        uv_px: float (N, 2).
    """
    gap = np.linalg.norm(uv_px[:, None] - trace.uv_px[None], axis=2)
    station = nearest_stations(gap, trace.overlaps)
    axes = trace.axes[station]
    offset = np.einsum("nij,nj->ni", axes, uv_px - trace.uv_px[station])
    return Located(station, offset / trace.length_px)


def placed(trace: Trace, places: Located) -> FloatArray:
    """Return the positions of places at the same shares of a trace's length, float64 (N, 2).

    Args:
        trace: A trace, in any image.
        places: Where they are along it.
    """
    axes = trace.axes[places.station]
    offset = np.einsum("nij,ni->nj", axes, places.offset * trace.length_px)
    return np.asarray(trace.uv_px[places.station] + offset)


def best_pair(source: Sequence[Trace], target: Sequence[Trace]) -> tuple[Trace, Trace]:
    """Return the traces that fit together best: both plausible, and of one length.

    Args:
        source: Traces in one image.
        target: Traces in the other.
    """

    def score(pair: tuple[Trace, Trace]) -> float:
        a, b = pair
        return a.score + b.score - abs(math.log(a.length_px / b.length_px))

    return max(itertools.product(source, target), key=score)
