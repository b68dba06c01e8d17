"""The rope tracer: a baseline without training that counts along the rope."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from pliant.baselines.pixels import central_position
from pliant.baselines.remarks import PICTURES, pictures_where, unread_remarks
from pliant.baselines.tracing.hypotheses import Trace, rope_traces
from pliant.baselines.tracing.mask_shape import MaskShape, has_ball
from pliant.baselines.tracing.reframing import Reframed, rectified
from pliant.baselines.tracing.transfer import best_pair, completed, located, placed, with_cut_ends
from pliant.spec.answers import Answers
from pliant.spec.frame import Frame, Pair
from pliant.spec.lru_cache import LRUCache

_KEPT_TRACES: Final = 128


class RopeTracer:
    """Follows the rope through both masks, and answers at the same arc length and side.

    It starts at the ball, or without a ball at both ends and keeps the better reading. It looks at
    masks alone, so materials and light do not matter; at crossings it goes wrong most often. A rope
    seen at a slant is traced in the view from straight above (`rectified`).
    """

    name = "rope-tracer"

    def __init__(self) -> None:
        self._traces: LRUCache[tuple[Reframed, list[Trace]]] = LRUCache(_KEPT_TRACES)

    def describe(self) -> Mapping[str, Any]:
        """Return the method's name."""
        return {"name": self.name}

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels; see `Matcher`.

        Where either mask is missing or shows no rope, the answer is the middle of the target.
        """
        source, target, uv_a_px = pair.source, pair.target, pair.uv_a_px
        (above_a, in_source), (above_b, in_target) = self._of(source), self._of(target)
        if not in_source or not in_target:
            return Answers(np.repeat(central_position(target)[None], len(uv_a_px), axis=0))
        trace_a, trace_b = best_pair(*completed(in_source, in_target))
        found = placed(trace_b, located(trace_a, above_a.forward(uv_a_px)))
        answers = above_b.back(Answers(found.astype(np.float32)))
        size = np.array(target.rgb.shape[1::-1], dtype=np.float32)
        return Answers(answers.uv_px.clip(0, size))

    def remarks(self, source: Frame, target: Frame) -> list[str]:
        """Return what should be known of two pictures, as sentences; see `RemarkingMatcher`."""
        views = (source, target)
        traces = [self._of(view)[1] for view in views]
        if unread := unread_remarks(map(bool, traces), self.name, "that shows a rope", "rope"):
            return unread
        shapes = [
            None if view.mask is None else MaskShape.of(view.mask, view.objects) for view in views
        ]
        return rope_remarks(views, shapes, traces)

    def _of(self, view: Frame) -> tuple[Reframed, list[Trace]]:
        def traced() -> tuple[Reframed, list[Trace]]:
            above = rectified(view)
            mask = above.view.mask
            if mask is None:
                return above, []
            traces = rope_traces(mask, above.view.objects, nadir=above.nadir)
            return above, with_cut_ends(traces, above)

        return self._traces.get(view.cache_key, traced)


def rope_remarks(
    views: Sequence[Frame],
    shapes: Sequence[MaskShape | None],
    traces: Sequence[Sequence[Trace]],
) -> list[str]:
    """Return what is to be said of the masks of ropes and of how they are read.

    Args:
        views: Source and target with the masks that are used.
        shapes: Shapes of the masks, or None without a mask.
        traces: Traces of each, from `with_cut_ends`, the most plausible first.
    """
    named = zip(PICTURES, shapes, strict=True)
    found = [shape.remark(name) for name, shape in named if shape is not None]
    remarks = [remark for remark in found if remark]
    bare = pictures_where(view.mask is not None and not has_ball(view) for view in views)
    if bare and not remarks:
        remarks.append(
            f"No ball is known at an end of the rope in the {bare}: without one, both ends look "
            "alike, and all answers may run the other way along the rope."
        )
    if cut := pictures_where(bool(each) and any(each[0].cut) for each in traces):
        remarks.append(
            f"The rope leaves the picture of the {cut}: how much of it is outside is taken from "
            "its width, as if both pictures showed one and the same rope."
        )
    if back := pictures_where(bool(each) and each[0].comes_back for each in traces):
        remarks.append(
            f"The rope leaves the picture of the {back} and comes back: the way that it takes "
            "outside is a guess."
        )
    return remarks
