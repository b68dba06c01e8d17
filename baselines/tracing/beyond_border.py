"""Ropes that leave the picture: traces that go on beyond its border for as long as the rope does.

A rope has as many widths of length in every picture of it. Where an end of a trace is at the border
and the trace is shorter, in widths, than that of the other picture, it goes on in its direction,
outside, for what is missing; places then have the shares of the whole rope again. A rope that
comes back is joined outside, before it is traced (`bridging.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pliant.baselines.tracing.centring import evenly_spaced
from pliant.baselines.tracing.hypotheses import Trace
from pliant.baselines.tracing.mask_shape import has_ball
from pliant.baselines.tracing.reframing import Reframed
from pliant.baselines.tracing.settings import TRACING
from pliant.spec.answers import Answers
from pliant.spec.arrays import FloatArray


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
