"""What a matching method must offer: the `Matcher` protocol."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from pliant.spec.dataset import Dataset


@dataclass(frozen=True)
class View:
    """One frame, as a method is allowed to see it.

    Attributes:
        rgb: uint8 (H, W, 3), sRGB.
        mask: bool (H, W), True where the queried object is seen, or None where masks are not
            given out.
        depth_m: float32 (H, W), planar z in metres, +inf is background, or None.
        key: Stable name of the frame (`sequence/frame`), for caches of descriptors.
        objects: bool (H, W), True where any object is seen (a rope's ball too), or None.
    """

    rgb: npt.NDArray[np.uint8]
    mask: npt.NDArray[np.bool_] | None = None
    depth_m: npt.NDArray[np.float32] | None = None
    key: str = ""
    objects: npt.NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class Answers:
    """Where a method sees N query pixels in the target image.

    Attributes:
        uv_px: float32 (N, 2), finite.
        visible: float32 (N,), probabilities, or None.
        sigma_px: float32 (N,), > 0, or None.
        modes: one float32 (M_i, 4) array a query of (u, v, sigma, weight), or None.
        familiarity: float32 (N,), 0 to 1: the share of the queries of its training domain that
            are at least as unusual as this one, or None. Not part of a submission's rows.
    """

    uv_px: npt.NDArray[np.float32]
    visible: npt.NDArray[np.float32] | None = None
    sigma_px: npt.NDArray[np.float32] | None = None
    modes: list[npt.NDArray[np.float32]] | None = None
    familiarity: npt.NDArray[np.float32] | None = None

    def rows(self, rows: npt.NDArray[np.int64]) -> Answers:
        """Return the answers to some of the queries, int64 (M,), in that order."""
        return Answers(
            self.uv_px[rows],
            None if self.visible is None else self.visible[rows],
            None if self.sigma_px is None else self.sigma_px[rows],
            None if self.modes is None else [self.modes[row] for row in rows],
            None if self.familiarity is None else self.familiarity[rows],
        )


UNFAMILIAR = 0.02
"""An answer of lower familiarity is called unlike what its method was trained on."""


def familiarity_summary(familiarity: npt.NDArray[np.float32]) -> dict[str, float]:
    """Return the median and the share below `UNFAMILIAR`, for the footer of a submission."""
    return {
        "median": round(float(np.median(familiarity)), 4),
        f"share_below_{UNFAMILIAR}": round(float(np.mean(familiarity < UNFAMILIAR)), 4),
    }


@dataclass(frozen=True)
class Matches:
    """A sparse method's own keypoint matches.

    Attributes:
        uv_a_px: float32 (M, 2), keypoints in the source image.
        uv_b_px: float32 (M, 2), their matches in the target image.
        score: float32 (M,), higher is better.
    """

    uv_a_px: npt.NDArray[np.float32]
    uv_b_px: npt.NDArray[np.float32]
    score: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Heat:
    """How strongly a method believes in each pixel of the target, for one query.

    Attributes:
        values: float32 (H, W), higher is better, NaN where the method does not look.
        label: What the values are, for a colour bar.
        confidence: How sure the method is of its answer, 0 to 1.
        confidence_label: What that number is.
    """

    values: npt.NDArray[np.float32]
    label: str
    confidence: float
    confidence_label: str


class Matcher(Protocol):
    """A method that finds query pixels of a source image in a target image."""

    name: str

    def describe(self) -> Mapping[str, Any]:
        """Return JSON-able facts for the submission's footer: name, settings, versions."""
        ...

    def answer(self, source: View, target: View, uv_a_px: npt.NDArray[np.float32]) -> Answers:
        """Answer query pixels.

        Args:
            source: The image the queries are in.
            target: The image to find them in.
            uv_a_px: float32 (N, 2), query pixels, centre of the first pixel at (0.5, 0.5).

        Returns:
            One answer for every query, in order.
        """
        ...


@runtime_checkable
class KeypointMatcher(Matcher, Protocol):
    """A sparse method that also has keypoint matches of its own."""

    def match(self, source: View, target: View) -> Matches:
        """Return the method's own matches between two images."""
        ...


@runtime_checkable
class HeatMatcher(Matcher, Protocol):
    """A method that can show where else it would have looked."""

    def heat(self, source: View, target: View, uv_a_px: npt.NDArray[np.float32]) -> Heat:
        """Return the method's belief over the target for one query.

        Args:
            source: The image the query is in.
            target: The image to find it in.
            uv_a_px: float32 (2,), the query pixel.
        """
        ...


@runtime_checkable
class TrackMatcher(Matcher, Protocol):
    """A method that follows points through the frames of an episode.

    Pairs within one episode are answered by tracking, all others by `answer`.
    """

    def track(self, views: Iterable[View], uv_px: npt.NDArray[np.float32]) -> Iterator[Answers]:
        """Carry points through consecutive frames.

        Args:
            views: At least one frame, in the order of time or against it, read one by one as
                the answers are taken; the points are in the first.
            uv_px: float32 (N, 2), the points.

        Yields:
            For each frame after the first, one answer for every point, in order.
        """
        ...


@runtime_checkable
class SplitMatcher(Protocol):
    """A method that answers a whole split at once, without looking at images."""

    name: str

    def describe(self) -> Mapping[str, Any]:
        """Return JSON-able facts for the submission's footer."""
        ...

    def answer_split(self, dataset: Dataset, split: str) -> Answers:
        """Answer every query of a split, in the order of the queries file.

        Args:
            dataset: The dataset.
            split: The split.
        """
        ...
