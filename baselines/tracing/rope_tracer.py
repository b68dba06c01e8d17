"""The rope tracer: a baseline without training that counts along the rope."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.lru_cache import LRUCache
from pliant.baselines.matcher import Answers, View
from pliant.baselines.pixels import central_position
from pliant.baselines.tracing.hypotheses import Trace, rope_traces
from pliant.baselines.tracing.transfer import best_pairs, transferred

_KEPT_TRACES: Final = 128


class RopeTracer:
    """Follows the rope through both masks, and answers at the same arc length and side.

    It starts at the ball, or without a ball at both ends and keeps the better reading. It looks at
    masks alone, so materials and light do not matter; at crossings it goes wrong most often.
    """

    name = "rope-tracer"

    def __init__(self) -> None:
        self._traces: LRUCache[list[Trace]] = LRUCache(_KEPT_TRACES)

    def describe(self) -> Mapping[str, Any]:
        """Return the method's name."""
        return {"name": self.name}

    def answer(self, source: View, target: View, uv_a_px: npt.NDArray[np.float32]) -> Answers:
        """Answer query pixels; see `Matcher`.

        Where either mask is missing or shows no rope, the answer is the middle of the target.
        """
        in_source, in_target = self._of(source), self._of(target)
        if not in_source or not in_target:
            return Answers(np.repeat(central_position(target)[None], len(uv_a_px), axis=0))
        _, a, b = best_pairs(in_source, in_target, lambda a, b: 0.0, 1)[0]
        found = transferred(in_source[a], in_target[b], uv_a_px)
        size = np.array(target.rgb.shape[1::-1])
        return Answers(found.clip(0, size).astype(np.float32))

    def _of(self, view: View) -> list[Trace]:
        mask = view.mask
        if mask is None:
            return []
        return self._traces.get(view.key, lambda: rope_traces(mask, view.objects))
