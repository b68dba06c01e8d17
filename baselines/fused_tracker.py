"""Points followed by optical flow, and found again by a method that compares two pictures.

Flow from frame to frame is exact to a fraction of a pixel while a point is seen, and is lost where
something covers it. A matcher is less exact and does not depend on the frames between. They are
joined as in ProTracker (Zhang and others, arXiv 2501.03220): each gives a Gaussian around where it
sees a point, and their product is the answer. Both may also be wrong: the flow may have left the
point for what covers it, and the matcher may take a part of the object for another one. Which of
them is right follows from how well they agree, at the point and at the points around it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pliant.baselines.answers import checked_answers
from pliant.baselines.flow import RETURN_PX, FlowChain
from pliant.baselines.matcher import Matcher, SharingMatcher, SplitMatcher
from pliant.spec.answers import Answers
from pliant.spec.arrays import BoolArray, Float32Array, FloatArray
from pliant.spec.calls import check_whole
from pliant.spec.errors import CallError
from pliant.spec.frame import Frame, Pair

PREFIX: Final = "fused:"
"""`fused:METHOD` is a method's name."""

_LEAST_SIGMA_PX: Final = 0.3
"""Of an answer."""

_STEPS: Final = 5
"""Of expectation maximisation."""

_UNKNOWN_SIGMA_PX: Final = 8.0
"""Of a matcher that does not say how sure it is."""


@dataclass(frozen=True)
class Trust:
    """How far flow and matcher are trusted, chosen on 10 validation episodes of ropes.

    Attributes:
        drift_px: Standard deviation of a step of the flow.
        lost_px: The same of a point that the flow has lost.
        slip: Probability that a step of the flow leaves the point unnoticed.
        lost_slip: The same where the flow has lost the point.
        right: Probability that the matcher is right where nothing is known of its neighbours.
        around_px: Distance in the first frame within which the matcher is right or wrong together.
        least_sigma_px: Least standard deviation of a mode of the matcher.
    """

    drift_px: float = 0.25
    lost_px: float = 8.0
    slip: float = 0.01
    lost_slip: float = 0.1
    right: float = 0.5
    around_px: float = 100.0
    least_sigma_px: float = 2.0


TRUST: Final = Trust()


@dataclass(frozen=True)
class _Belief:
    """Where N points are believed to be.

    Attributes:
        position_px: float64 (N, 2).
        variance: float64 (N,), px², of a coordinate.
        followed: float64 (N,), probability that this is the point and not another.
    """

    position_px: FloatArray
    variance: FloatArray
    followed: FloatArray


class FusedTracker:
    """Follows points by dense inverse search and finds them again by another method.

    A point that the matcher calls hidden stays where it is until the next comparison.

    Args:
        matcher: The method that compares the first frame with a later one.
        every: Frames between two comparisons with the first frame, >= 1.

    Raises:
        CallError: The method answers whole splits only, or `every` is too small.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, matcher: Matcher | SplitMatcher, every: int = 8) -> None:
        if isinstance(matcher, SplitMatcher):
            raise CallError("this method does not compare two pictures", where=matcher.name)
        check_whole("every", every, least=1)
        self._every = every
        self.name = PREFIX + matcher.name
        self._matcher, self._flow = matcher, FlowChain("dis-chain")

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {
            "flow": self._flow.describe(),
            "matcher": self._matcher.describe(),
            "every": self._every,
            **asdict(TRUST),
        }

    def share(self, folder: Path) -> None:
        """Let the matcher's copies in other processes share what it finds; see `SharingMatcher`."""
        if isinstance(self._matcher, SharingMatcher):
            self._matcher.share(folder)

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels by the matcher alone; see `Matcher`."""
        return self._matcher.answer(pair)

    def track(self, views: Iterable[Frame], uv_px: Float32Array) -> Iterator[Answers]:
        """Carry points through consecutive frames; see `TrackMatcher`."""
        frames = iter(views)
        first = before = next(frames)
        count = len(uv_px)
        belief = _Belief(np.array(uv_px, np.float64), np.zeros(count), np.ones(count))
        covered = np.zeros(count, np.bool_)
        for number, view in enumerate(frames, start=1):
            start = belief.position_px.astype(np.float32)
            moved_px, back_px = self._flow.step(before.rgb, view.rgb, start)
            kept = (back_px < RETURN_PX) & ~covered
            belief = self._moved(belief, moved_px.clip(0, view.size), kept)
            visible = kept.astype(np.float32)
            if number % self._every == 0 and count:
                answered = self._matcher.answer(Pair(first, view, uv_px))
                found = checked_answers(answered, count, self._matcher.name, f"frame {view.key}")
                belief, agreed = self._fused(belief, found, uv_px, view.size)
                if found.visible is not None:
                    visible = np.where(agreed, found.visible, visible)
                    covered = agreed & (found.visible < 0.5)
            sigma = np.hypot(np.sqrt(belief.variance), _LEAST_SIGMA_PX).astype(np.float32)
            yield Answers(belief.position_px.astype(np.float32), visible, sigma)
            before = view

    def _moved(self, belief: _Belief, moved_px: Float32Array, kept: BoolArray) -> _Belief:
        """Return the belief after a step of the flow, which `kept` some points, bool (N,)."""
        return _Belief(
            np.where(kept[:, None], moved_px, belief.position_px),
            belief.variance + np.where(kept, TRUST.drift_px, TRUST.lost_px) ** 2,
            belief.followed * (1 - np.where(kept, TRUST.slip, TRUST.lost_slip)),
        )

    def _fused(
        self, belief: _Belief, found: Answers, uv_px: Float32Array, size: tuple[int, int]
    ) -> tuple[_Belief, BoolArray]:
        """Return the belief after a comparison, and for which points it counted, bool (N,).

        Where the flow has followed a point, the point is at a mode of the matcher, if that is
        right; otherwise it is anywhere in the picture, as it is if the matcher is wrong. A matcher
        errs in whole stretches of an object, so how often it is right is found from the points
        around (expectation maximisation), of which those count that the flow has followed.
        """
        anywhere = 1.0 / (size[0] * size[1])
        modes = _modes(found)  # (N, K, 4): u, v, variance, weight
        both = belief.variance[:, None] + modes[..., 2]
        apart = ((modes[..., :2] - belief.position_px[:, None]) ** 2).sum(axis=2)
        density = modes[..., 3] * np.exp(-apart / (2 * both)) / (2 * np.pi * both)
        agree = belief.followed * density.sum(axis=1)
        explained = agree + (1 - belief.followed) * anywhere

        def counting(right: FloatArray) -> FloatArray:
            return np.asarray(right * explained / (right * explained + (1 - right) * anywhere))

        near = _near(uv_px) * belief.followed
        counts = counting(np.full(len(uv_px), TRUST.right))
        for _ in range(_STEPS):
            counts = counting((near @ counts + TRUST.right) / (near.sum(axis=1) + 1))
        followed, counted = agree / explained, counts > 0.5
        joined = counted & (followed > 0.5)
        rows, best = np.arange(len(uv_px)), density.argmax(axis=1)
        gain = belief.variance / both[rows, best]
        nearest = modes[rows, best]
        strongest = modes[rows, modes[..., 3].argmax(axis=1)]
        position, variance = belief.position_px.copy(), belief.variance.copy()
        position += (gain * joined)[:, None] * (nearest[:, :2] - position)
        variance *= 1 - gain * joined
        moved = counted & ~joined
        position[moved], variance[moved] = strongest[moved, :2], strongest[moved, 2]
        # Where the matcher is wrong, the flow is right as often as before.
        kept = counts * followed + (1 - counts) * belief.followed
        return _Belief(position, variance, np.where(moved, counts, kept)), counted


def _near(uv_px: Float32Array) -> FloatArray:
    """Return how near points are to each other in the first frame, float64 (N, N), 0 to 1."""
    apart = ((uv_px[:, None].astype(np.float64) - uv_px[None]) ** 2).sum(axis=2)
    near: FloatArray = np.exp(-apart / (2 * TRUST.around_px**2))
    return near


def _modes(found: Answers) -> FloatArray:
    """Return the modes of N answers, float64 (N, K, 4) of (u, v, variance, weight)."""
    if found.modes is None:
        sigma = found.sigma_px
        rows = np.ones((len(found.uv_px), 1, 4))
        rows[:, 0, :2] = found.uv_px
        rows[:, 0, 2] = _UNKNOWN_SIGMA_PX if sigma is None else sigma
    else:
        rows = np.zeros((len(found.modes), max(map(len, found.modes)), 4))
        for row, own in zip(rows, found.modes, strict=True):
            row[: len(own)] = own
        rows[..., 3] /= rows[..., 3].sum(axis=1, keepdims=True)
    rows[..., 2] = np.maximum(rows[..., 2], TRUST.least_sigma_px) ** 2
    return rows
