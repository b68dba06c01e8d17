"""Optical flow, chained through the frames of an episode with a forward-backward check.

Lucas and Kanade (IJCAI 1981) in the pyramid of Bouguet (2000), and dense inverse search (Kroeger
and others, ECCV 2016), both by OpenCV. The check is that of Kalal and others (ICPR 2010): a point
that is followed to the next frame and back must return to where it started.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final

import numpy as np

from pliant.baselines.features.local_features import SMALLEST_SIDE_PX
from pliant.baselines.features.opencv_features import load_opencv
from pliant.baselines.pixels import HALF_PIXEL, luma
from pliant.spec.answers import Answers
from pliant.spec.arrays import BoolArray, Float32Array, ImageArray
from pliant.spec.frame import Frame, Pair

WINDOW_PX: Final = 15
"""Side of the window that Lucas-Kanade compares."""

PYRAMID_LEVELS: Final = 3
"""Levels above the full resolution."""

RETURN_PX: Final = 1.0
"""A point that returns farther than this from where it started was lost."""

MOST_RETURN_PX: Final = 16.0
"""Farther returns count as this in sigma."""

SIGMA_PX: Final = 0.3
"""Sigma of a point that was not moved."""

SIGMA_RETURN: Final = 2.0
"""Sigma per distance at which a point returns."""

SIGMA_FRAME_PX: Final = 0.05
"""Sigma per frame."""


def _lucas_kanade(
    cv2: Any, a: ImageArray, b: ImageArray, xy: Float32Array
) -> tuple[Float32Array, BoolArray]:
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        luma(a), luma(b), xy[:, None], None,
        winSize=(WINDOW_PX, WINDOW_PX), maxLevel=PYRAMID_LEVELS,
    )  # fmt: skip
    return found[:, 0], status[:, 0] > 0


def _inverse_search(
    cv2: Any, a: ImageArray, b: ImageArray, xy: Float32Array
) -> tuple[Float32Array, BoolArray]:
    dense = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    dense.setFinestScale(0)
    flow = dense.calc(luma(a), luma(b), None)  # (H, W, 2)
    moved = cv2.remap(
        flow, xy[None, :, 0], xy[None, :, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )[0]
    return xy + moved, np.ones(len(xy), dtype=np.bool_)


FLOWS: Final[
    dict[str, Callable[[Any, ImageArray, ImageArray, Float32Array], tuple[Float32Array, BoolArray]]]
] = {
    "lk-chain": _lucas_kanade,
    "dis-chain": _inverse_search,
}
"""Name -> (cv2, image, next image, points (N, 2) in OpenCV's convention) -> where they are in the
next image, float32 (N, 2), and which were followed, bool (N,)."""


class FlowChain:
    """Follows points from frame to frame by optical flow.

    A point that fails the forward-backward check stays where it was last seen, is answered as
    hidden, and is tried again in the next frame. Sigma² is the sum of the squares of three terms:
    a floor, the distances at which the point returned, and the number of frames. A pair that is
    not of one episode is one step.

    Args:
        name: One of `FLOWS`.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._flow = FLOWS[name]
        self._opencv()

    def _opencv(self) -> Any:
        return load_opencv(f"optical flow ({self.name})")

    def describe(self) -> Mapping[str, Any]:
        """Return name, settings and version for the submission's footer."""
        return {
            "name": self.name,
            "implementation": "opencv",
            "version": str(self._opencv().__version__),
            "return_px": RETURN_PX,
        }

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels by a single step; see `Matcher`."""
        return next(self.track([pair.source, pair.target], pair.uv_a_px))

    def track(self, views: Iterable[Frame], uv_px: Float32Array) -> Iterator[Answers]:
        """Carry points through consecutive frames; see `TrackMatcher`."""
        frames = iter(views)
        before = next(frames).rgb
        uv_px = np.array(uv_px, dtype=np.float32)
        returned = np.zeros(len(uv_px))  # px²
        for number, view in enumerate(frames, start=1):
            moved_px, back_px = self.step(before, view.rgb, uv_px)
            kept = back_px < RETURN_PX
            uv_px = np.where(kept[:, None], moved_px, uv_px)
            uv_px = uv_px.clip(0, view.rgb.shape[1::-1]).astype(np.float32)
            returned += np.minimum(back_px, MOST_RETURN_PX) ** 2
            variance = SIGMA_PX**2 + SIGMA_RETURN**2 * returned + (SIGMA_FRAME_PX * number) ** 2
            yield Answers(uv_px, kept.astype(np.float32), np.sqrt(variance).astype(np.float32))
            before = view.rgb

    def step(
        self, a: ImageArray, b: ImageArray, uv_px: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        """Carry points from one image to the next.

        Args:
            a: uint8 (H, W, 3).
            b: The next image, of any size.
            uv_px: float32 (N, 2), pixels of `a`.

        Returns:
            Where they are in `b`, float32 (N, 2), and how far from their start they end when
            carried back, float32 (N,) in pixels of `a`; inf for a point that was not followed.
        """
        if len(uv_px) == 0 or min(a.shape[:2] + b.shape[:2]) < SMALLEST_SIDE_PX:
            return uv_px, np.full(len(uv_px), np.inf, dtype=np.float32)
        cv2 = self._opencv()
        scale = np.array(b.shape[1::-1], dtype=np.float32) / a.shape[1::-1]
        if a.shape != b.shape:
            b = cv2.resize(b, a.shape[1::-1], interpolation=cv2.INTER_AREA)
        start = uv_px - np.float32(HALF_PIXEL)
        there, forward = self._flow(cv2, a, b, start)
        back, backward = self._flow(cv2, b, a, there)
        seen = forward & backward & np.isfinite(there).all(axis=1) & np.isfinite(back).all(axis=1)
        apart = np.hypot(*np.where(seen[:, None], back - start, np.inf).T)
        return (np.where(seen[:, None], there, start) + HALF_PIXEL) * scale, apart
