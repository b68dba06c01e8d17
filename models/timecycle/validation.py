"""Validation during a run: tracking errors, compared with the trivial answers.

A prior, a temperature and a memory that suit one encoder spoil another: descriptors that separate
well want a sharp softmax and a loose prior, poor ones the opposite. Encoders are compared fairly
when each is read in the way that suits it, chosen on the same validation stretches.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pliant.baselines.pixels import central_position
from pliant.evaluator.metrics.errors import endpoint_error_px, rmse_px
from pliant.loaders.frame_store import FrameStore
from pliant.loaders.order import sample_generator
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.settings import PropagationSettings, TrackValidationSettings
from pliant.spec.arrays import BoolArray, Float32Array, FloatArray, IntArray
from pliant.spec.errors import CallError
from pliant.spec.frame import Frame

VALIDATION_STREAM: Final = 1
WIDE_PX: Final = 640
"""Errors are given in pixels of a picture this wide, whatever the dataset's size."""

LISTED: Final = (1, 5, 10, 20, 40, 80)
"""Frames since the query at which errors are listed."""

Track = Callable[["Stretch"], Iterator[Float32Array]]
"""Where a method sees a stretch's points in each frame after the first, working pixels."""


@dataclass(frozen=True)
class Stretch:
    """Consecutive frames of an episode with points of the first.

    Attributes:
        store: Where the frames are.
        frames: Their numbers in it, F + 1 of them.
        points: int64 (Q,), points visible in the first frame.
    """

    store: FrameStore
    frames: range
    points: IntArray

    def views(self) -> Iterator[Frame]:
        """Yield the frames, at the working size."""
        for number in self.frames:
            yield self.store.view(number).replace()

    def truth(self) -> tuple[Float32Array, BoolArray]:
        """Return where the points are, float32 (F + 1, Q, 2), and whether the camera sees them."""
        views = [self.store.view(number) for number in self.frames]
        uv = np.stack([view.uv_px[self.points] for view in views])
        seen = np.stack([view.visible[self.points] for view in views])
        return np.nan_to_num(uv), seen & np.isfinite(uv).all(axis=2)


def draw_stretches(
    store: FrameStore, settings: TrackValidationSettings, seed: int
) -> list[Stretch]:
    """Draw stretches of episodes, the same for the same seed, spread over the episodes in turn.

    Args:
        store: Frames of the validation split.
        settings: How many, how long, how many points.
        seed: Seed of the draws.

    Raises:
        CallError: No episode is long enough.
    """
    first = [number for number, ref in enumerate(store.frames) if ref.index == 0]
    episodes = [
        number
        for number in first
        if store.frames[number].sequence.temporal
        and store.frames[number].sequence.frames > settings.frames
    ]
    if not episodes:
        raise CallError(
            f"validation found no episode of {settings.frames + 1} frames or more",
            path=store.root,
            where=store.where,
            fix="Use longer episodes, or a smaller validation.frames",
        )
    stretches = []
    for clip in range(settings.clips):
        rng = sample_generator(seed, clip, VALIDATION_STREAM)
        episode = episodes[clip % len(episodes)]
        room = store.frames[episode].sequence.frames - settings.frames
        start = episode + int(rng.integers(room))
        seen = np.flatnonzero(store.view(start).visible)
        if len(seen) == 0:
            continue
        points = rng.choice(seen, size=min(settings.queries, len(seen)), replace=False)
        stretches.append(Stretch(store, range(start, start + settings.frames + 1), points))
    if not stretches:
        raise CallError("no validation clip has a visible point", found=f"{settings.clips} tried")
    return stretches


def track_with(matcher: TimeCycleMatcher) -> Track:
    """Return how a matcher tracks."""

    def track(stretch: Stretch) -> Iterator[Float32Array]:
        start = stretch.store.view(stretch.frames[0]).uv_px[stretch.points]
        for answers in matcher.track(stretch.views(), start):
            yield answers.uv_px

    return track


def track_identity(stretch: Stretch) -> Iterator[Float32Array]:
    """Say that nothing moves."""
    start = stretch.store.view(stretch.frames[0]).uv_px[stretch.points]
    for _ in stretch.frames[1:]:
        yield start


def track_centroid(stretch: Stretch) -> Iterator[Float32Array]:
    """Say that every point is in the middle of the object's mask."""
    for number in stretch.frames[1:]:
        middle = central_position(stretch.store.view(number))
        yield np.tile(middle, (len(stretch.points), 1))


def errors_over_time(track: Track, stretches: Sequence[Stretch]) -> list[FloatArray]:
    """Return a method's errors for each number of frames since the query.

    Args:
        track: The method.
        stretches: From `draw_stretches`.

    Returns:
        F arrays; array k holds the distances k + 1 frames after the query, of all points that
        the camera sees there, in pixels of a picture 640 wide.
    """
    frames = len(stretches[0].frames) - 1
    errors: list[list[FloatArray]] = [[] for _ in range(frames)]
    for stretch in stretches:
        scale = WIDE_PX / stretch.store.size[0]
        truth, seen = stretch.truth()
        for step, found in enumerate(track(stretch)):
            distance = endpoint_error_px(found, truth[step + 1]) * scale
            errors[step].append(distance[seen[step + 1]])
    return [np.concatenate(parts) for parts in errors]


def curve(errors: Sequence[FloatArray]) -> list[float]:
    """Return the RMSE for each number of frames since the query; NaN where no point is seen."""
    return [rmse_px(each) if len(each) else float("nan") for each in errors]


def figures(errors: Sequence[FloatArray]) -> dict[str, float]:
    """Return the errors in a few numbers.

    Args:
        errors: From `errors_over_time`.

    Returns:
        `rmse_px_K` after K frames for each K of `LISTED` there is, `rmse_px` over all frames,
        and `criterion_px`, the mean of the last half of the curve.
    """
    values = curve(errors)
    listed = {f"rmse_px_{frames}": values[frames - 1] for frames in LISTED if frames <= len(values)}
    late = np.array(values[len(values) // 2 :])
    every = np.concatenate(list(errors))
    return {
        **{name: value for name, value in listed.items() if np.isfinite(value)},
        "rmse_px": rmse_px(every),
        "criterion_px": float(np.nanmean(late)) if np.isfinite(late).any() else rmse_px(every),
    }


TRIED: Final[dict[str, tuple[float, ...]]] = {
    "prior": (0.7, 1.5, 3.0),
    "temperature": (0.01, 0.03, 0.1),
    "first_weight": (0.0, 0.25, 1.0),
}
"""What is tried; `prior` in fortieths of the picture's width."""


def choose_readout(matcher: TimeCycleMatcher, stretches: Sequence[Stretch]) -> PropagationSettings:
    """Return the settings with the lowest error late in the stretches.

    Args:
        matcher: The matcher; its own settings give what is not tried.
        stretches: Validation stretches.
    """
    own = matcher.settings.propagation
    names = list(TRIED)
    tried = [
        own.replace(**dict(zip(names, values, strict=True)))
        for values in itertools.product(*TRIED.values())
    ]
    cells = matcher.settings.width / 40 / own.stride
    tried = [each.replace(prior=each.prior * cells) for each in tried]
    return min(tried, key=lambda each: _error(matcher.read_by(each), stretches))


def _error(matcher: TimeCycleMatcher, stretches: Sequence[Stretch]) -> float:
    return figures(errors_over_time(track_with(matcher), stretches))["criterion_px"]
