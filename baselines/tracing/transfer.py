"""Carrying places from a trace in one image to a trace in another: same arc length, same side."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.baselines.tracing.crossings import nearest_stations
from pliant.baselines.tracing.depth_in_mask import FloatArray
from pliant.baselines.tracing.hypotheses import Trace


def transferred(source: Trace, target: Trace, uv_px: npt.NDArray[np.floating[Any]]) -> FloatArray:
    """Return where places on one trace are on another.

    A place keeps the share of the length at which it is, and the side of the rope: its offset from
    the nearest station, along and across the source's trace, scaled by the ratio of the lengths.
    Where one strand is known to cover another, a place on both is on the upper one.

    Args:
        source: The trace in the queries' image.
        target: The trace in the other image.
        uv_px: float (N, 2).

    Returns:
        float64 (N, 2).
    """
    gap = np.linalg.norm(uv_px[:, None] - source.uv_px[None], axis=2)
    station = nearest_stations(gap, source.overlaps)
    axes_a, axes_b = _axes(source.uv_px)[station], _axes(target.uv_px)[station]
    offset = np.einsum("nij,nj->ni", axes_a, uv_px - source.uv_px[station])
    offset *= target.length_px / source.length_px
    return np.asarray(target.uv_px[station] + np.einsum("nij,ni->nj", axes_b, offset))


def best_pairs(
    source: Sequence[Trace],
    target: Sequence[Trace],
    agreement: Callable[[int, int], float],
    count: int,
) -> list[tuple[float, int, int]]:
    """Return the pairs of traces that fit together best.

    Both are of one rope: what speaks for a pair is the plausibility of each, the same length, and
    how well they agree in whatever else is known.

    Args:
        source: Traces in one image.
        target: Traces in the other.
        agreement: Of a source's and a target's number, higher is better.
        count: How many pairs at most.

    Returns:
        (score, number in source, number in target), the best first.
    """
    scored = [
        (
            a.score
            + b.score
            - abs(math.log(a.length_px / b.length_px))
            + agreement(number_a, number_b),
            number_a,
            number_b,
        )
        for number_a, a in enumerate(source)
        for number_b, b in enumerate(target)
    ]
    return sorted(scored, reverse=True)[:count]


def _axes(uv_px: FloatArray) -> FloatArray:
    """Return the unit vectors along and across a trace at its S stations, float64 (S, 2, 2)."""
    way = np.gradient(uv_px, axis=0)
    way /= np.linalg.norm(way, axis=1, keepdims=True) + 1e-9
    return np.stack([way, np.stack([-way[:, 1], way[:, 0]], axis=1)], axis=1)
