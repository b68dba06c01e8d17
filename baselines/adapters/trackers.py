"""A matcher made of a function that tracks points through a clip."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.baselines.adapters.images import Images, as_probability, function_name, in_two
from pliant.baselines.answers import to_array
from pliant.spec.answers import Answers
from pliant.spec.arrays import Float32Array
from pliant.spec.calls import check_whole
from pliant.spec.errors import SubmissionError
from pliant.spec.frame import Frame, Pair

TrackFunction = Callable[[Any, Float32Array], Any]
"""(frames, points (N, 2) in the first frame) -> tracks (T, N, 2), alone or with the probability
(T, N) that a point is visible; with or without a batch dimension of 1."""


class TrackerMatcher:
    """Follows points by clips; a pair of images is a clip of two frames.

    Args:
        function: Tracks points through frames, uint8 (T, H, W, 3), or float32 (T, 3, H, W), 0 to
            1, where `images` names a device.
        name: Name of the method.
        images: How the function receives frames and counts positions.
        window: Most frames of a clip, >= 2; the next one starts from the last frame's answers.
            None gives all frames at once.
        batch: Most points of a call; None gives all at once.
    """

    def __init__(
        self,
        function: TrackFunction,
        name: str,
        images: Images,
        window: int | None = None,
        batch: int | None = None,
    ) -> None:
        for what, value, least in (("window", window, 2), ("batch", batch, 1)):
            if value is not None:
                check_whole(what, value, least)
        self.name = name
        self._function, self._images = function, images
        self._window, self._batch = window, batch

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {"implementation": "point tracker", "window": self._window}

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels by a clip of two frames; see `Matcher.answer`."""
        return next(self.track([pair.source, pair.target], pair.uv_a_px))

    def track(self, views: Iterable[Frame], uv_px: Float32Array) -> Iterator[Answers]:
        """Carry points through consecutive frames; see `TrackMatcher.track`.

        Raises:
            SubmissionError: The function returned tracks of another shape.
        """
        clip: list[Frame] = []
        points = uv_px
        for view in views:
            clip.append(view)
            if len(clip) == self._window:
                found = self._clip(clip, points)
                yield from found
                clip, points = [view], found[-1].uv_px
        if len(clip) > 1:
            yield from self._clip(clip, points)

    def _clip(self, clip: list[Frame], uv_px: Float32Array) -> list[Answers]:
        """Return the answers in each frame after the first."""
        frames = self._images.images(clip)
        count = max(len(uv_px), 1)
        parts = [
            self._call(frames, self._images.to_function(uv_px[at : at + step], clip[0]))
            for step in (self._batch or count,)
            for at in range(0, count, step)
        ]
        tracks = np.concatenate([tracks for tracks, _ in parts], axis=1)
        seen = [visible for _, visible in parts if visible is not None]
        visible = np.concatenate(seen, axis=1) if seen else None
        return [
            Answers(
                self._images.from_function(tracks[step], clip[step]).astype(np.float32),
                None if visible is None else as_probability(visible[step]),
            )
            for step in range(1, len(clip))
        ]

    def _call(
        self, frames: Any, points: Float32Array
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any] | None]:
        found = self._function(frames, points)
        tracked, seen = in_two(found, self.name)
        tracks = to_array(tracked)
        shape = (len(frames), len(points))
        if tracks.size != 2 * shape[0] * shape[1] or tracks.shape[-3:] != (*shape, 2):
            raise SubmissionError(
                f"the method {self.name!r} returned no tracks",
                found=f"shape {tracks.shape}",
                required=f"{(*shape, 2)}, for {shape[0]} frames and {shape[1]} points",
            )
        visible = None if seen is None else to_array(seen).astype(np.float64)
        if visible is not None and visible.squeeze().shape != tracks[..., 0].squeeze().shape:
            raise SubmissionError(
                f"the method {self.name!r} returned no visibility of its tracks",
                found=f"shape {visible.shape}",
                required=f"{shape}",
            )
        return tracks.reshape(*shape, 2), None if visible is None else visible.reshape(shape)


def from_tracker(
    function: TrackFunction,
    *,
    name: str | None = None,
    images: Images | None = None,
    window: int | None = None,
    batch: int | None = None,
) -> TrackerMatcher:
    """Return a matcher of a function that tracks points.

    Args:
        function: (frames, points (N, 2) in the first frame) -> tracks (T, N, 2), or a tuple of
            them and the probability (T, N) that a point is visible.
        name: Name of the method; None takes the function's.
        images: How the function receives frames and counts positions.
        window: Most frames of a clip; None gives all frames at once.
        batch: Most points of a call; None gives all at once.
    """
    return TrackerMatcher(
        function, name or function_name(function), images or Images(), window, batch
    )
