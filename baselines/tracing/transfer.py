"""Carrying places from a trace in one image to a trace in another: same arc length, same side.

A rope does not roll on its table, but a camera sees it in a direction that leans by
l = atan(n (x - x_0) / f) across it and by t (x - x_0) / f along it, with t and n the directions
along and across in the image, and x_0 where the camera looks straight down. A place at the offset o
from the middle of a rope of half width h is at the angle a = asin(o / h) - l from its highest line.
Another image shows that angle at the offset h' sin(a + l'). Each image shows the place
h cos(a) t (x - x_0) / f further along than the middle, which is lower.

Some ropes leave the picture. A rope has as many widths of length in every picture of it. Where an
end of a trace is at the border and the trace is shorter, in widths, than that of the other picture,
it goes on in its direction, outside, for what is missing; places then have the shares of the whole
rope again. A rope that comes back is joined outside, before it is traced (`bridging.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.baselines.tracing.centring import evenly_spaced
from pliant.baselines.tracing.crossings import nearest_stations
from pliant.baselines.tracing.hypotheses import Trace
from pliant.baselines.tracing.mask_shape import has_ball
from pliant.baselines.tracing.reframing import Reframed
from pliant.baselines.tracing.settings import TRACING
from pliant.spec.answers import Answers
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


def with_cut_ends(traces: Sequence[Trace], seen: Reframed) -> list[Trace]:
    """Return traces that say which of their ends are at the border of the picture.

    Args:
        traces: Traces in `seen`; where a ball is known, they begin at it, inside the picture.
        seen: The picture.
    """
    at_ball = has_ball(seen.view) is True
    height, width = (seen.original or seen.view).rgb.shape[:2]
    found = []
    for trace in traces:
        ends = trace.uv_px[[0, -1]]
        places = seen.back(Answers(ends.astype(np.float32))).uv_px
        away = np.minimum(places, [width, height] - places).min(axis=1)
        near = away <= TRACING.border_reach * trace.half_px + TRACING.border_px
        found.append(replace(trace, cut=(bool(near[0]) and not at_ball, bool(near[1]))))
    return found


def completed(
    source: Sequence[Trace], target: Sequence[Trace]
) -> tuple[Sequence[Trace], Sequence[Trace]]:
    """Return the traces of two pictures of one rope, those of cut ropes with what is outside.

    Args:
        source: Traces in one picture, from `with_cut_ends`, the most plausible first.
        target: Traces in the other.
    """
    if not source or not target:
        return source, target
    return (
        [_continued(trace, target[0]) for trace in source],
        [_continued(trace, source[0]) for trace in target],
    )


def _continued(trace: Trace, other: Trace) -> Trace:
    """Return a trace with one end cut that goes on there for as long as another; others come back.

    Where the other one is cut too, it must be at the same end: if not, its length says nothing.
    """
    length_px = other.length_px / other.half_px * trace.half_px
    missing_px = length_px - trace.length_px
    if sum(trace.cut) != 1 or (any(other.cut) and other.cut != trace.cut) or missing_px <= 0:
        return trace
    count = len(trace.uv_px)
    line = trace.uv_px if trace.cut[1] else trace.uv_px[::-1]
    way = line[-1] - line[-1 - count // 20]
    end = line[-1] + way * missing_px / max(float(np.linalg.norm(way)), 1e-9)
    longer = np.vstack([line, end])
    whole: FloatArray = evenly_spaced(longer, count)[0]
    share = trace.length_px / length_px
    before = 0.0 if trace.cut[1] else (1 - share) * (count - 1)

    def moved(part: slice) -> slice:
        return slice(round(before + part.start * share), round(before + part.stop * share))

    overlaps = tuple(
        replace(each, first=moved(each.first), second=moved(each.second)) for each in trace.overlaps
    )
    return replace(
        trace,
        uv_px=whole if trace.cut[1] else whole[::-1],
        length_px=length_px,
        overlaps=overlaps,
    )
