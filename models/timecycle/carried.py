"""Points carried through episodes by the descriptors of a trained Dense Object Net.

The descriptors of a supervised network are read as those of TimeCycle are: frame by frame, near
where the point is expected. Optical flow says where that is, so a point that moves fast is
followed, and the descriptors bring back what the flow loses. This is the other way to join flow
and a matcher than `baselines/fused_tracker.py`: every frame is compared, and no whole answer is
computed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

import numpy as np
import torch

from pliant.baselines.flow import RETURN_PX, FlowChain
from pliant.models.don.matcher import DonMatcher
from pliant.models.timecycle import CARRIED
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.network import TimeCycleNetwork
from pliant.models.timecycle.propagation import Propagator
from pliant.models.timecycle.settings import ClipSettings, PropagationSettings, TimeCycleSettings
from pliant.spec.answers import Answers
from pliant.spec.arrays import Float32Array
from pliant.spec.calls import check_type
from pliant.spec.errors import CallError
from pliant.spec.frame import Frame, Pair

READ: Final = PropagationSettings(
    stride=4,
    temperature=0.1,
    first_weight=1.0,
    prior=3.0,
    smooth=3.0,
    refine=1,
    search="mask",
)
"""How the descriptors are read, chosen on 10 validation episodes of ropes."""

_LIFT: Final = 8.0
"""Length of a constant channel: products of unit descriptors then follow their distances."""


class CarriedPoints:
    """Follows points by the descriptors of Dense Object Nets, and pairs as the network does.

    Args:
        matcher: The trained network.
        flow: Whether optical flow says where a point is expected, or its last place.
        options: Fields of `PropagationSettings`, instead of those of `READ`.

    Raises:
        CallError: An option is unknown or of a wrong type, or the network's input is the depth map.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, matcher: DonMatcher, flow: bool = True, **options: Any) -> None:
        check_type("flow", flow, bool, required="true or false")
        self.name = CARRIED + matcher.name
        self._matcher = matcher
        self._flow = FlowChain("dis-chain") if flow else None
        # The network takes any size, TimeCycle sides from 32 px of whole cells.
        width, height = (max(32, math.ceil(side / 8) * 8) for side in matcher.size)
        if matcher.input.kind == "depth":
            raise CallError(
                "this network has no picture input and cannot carry points", where=matcher.name
            )
        settings = TimeCycleSettings(
            width=width,
            height=height,
            clips=ClipSettings(input=matcher.input.kind, masks=matcher.input.masks),
            lift=_LIFT,
            propagation=READ.replace(**options),
        )
        network = TimeCycleNetwork(settings)
        network.encoder = matcher.network
        self._reader = TimeCycleMatcher(network, settings)

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {
            "matcher": self._matcher.describe(),
            "flow": None if self._flow is None else self._flow.describe(),
            "propagation": self._reader.describe()["propagation"],
        }

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels by the matcher alone; see `Matcher`."""
        return self._matcher.answer(pair)

    def track(self, views: Iterable[Frame], uv_px: Float32Array) -> Iterator[Answers]:
        """Carry points through consecutive frames; see `TrackMatcher`."""
        frames = map(self._with_mask, views)
        first = before = next(frames)
        points = self._reader.propagator(first, uv_px)
        for view in frames:
            expected = self._expected(points, before, view)
            yield Answers(self._reader.carry(points, view, expected))
            before = view

    def _with_mask(self, view: Frame) -> Frame:
        return view if view.mask is not None else self._matcher.reader.masked(view)

    def _expected(self, points: Propagator, before: Frame, view: Frame) -> torch.Tensor | None:
        """Return where the flow takes the carried points and their support, cells (N, 2)."""
        if self._flow is None:
            return None
        start = self._reader.pixels(points.xy, before)
        moved_px, back_px = self._flow.step(before.rgb, view.rgb, start)
        kept = np.where((back_px < RETURN_PX)[:, None], moved_px, start)
        return self._reader.cells(kept, view)
