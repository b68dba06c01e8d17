"""The `Matcher` protocol of matching methods, and optional protocols."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from pliant.spec.answers import Answers, Matches
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame, Pair

UNFAMILIAR = 0.02
"""Answers of lower familiarity count as unlike the training data of the method."""


def written_familiarity(familiarity: float) -> str:
    """Return a familiarity for people, rounded down: one below `UNFAMILIAR` never shows as it."""
    return f"{math.floor(100 * familiarity) / 100:.2f}"


def familiarity_summary(familiarity: npt.NDArray[np.float32]) -> dict[str, float]:
    """Return the median and the share below `UNFAMILIAR`, for the footer of a submission."""
    return {
        "median": round(float(np.median(familiarity)), 4),
        f"share_below_{UNFAMILIAR}": round(float(np.mean(familiarity < UNFAMILIAR)), 4),
    }


@dataclass(frozen=True)
class Heat:
    """The probability of each pixel of the target, or a similar score, for one query.

    Attributes:
        values: float32 (H, W), higher is better, NaN for pixels that are not searched.
        label: Name of the values, for a colour bar.
        confidence: Confidence of the answer, 0 to 1.
        confidence_label: Name of the confidence.
    """

    values: npt.NDArray[np.float32]
    label: str
    confidence: float
    confidence_label: str


class Matcher(Protocol):
    """A method that finds query pixels of a source image in a target image.

    Examples:
        >>> class Unmoved:
        ...     name = "unmoved"
        ...     def describe(self):
        ...         return {"name": self.name}
        ...     def answer(self, pair):
        ...         return pliant.baselines.Answers(pair.uv_a_px)
        >>> pliant.evaluate("sample", pliant.predict("sample", Unmoved())).overall["pck_8px"] < 0.5
        True
    """

    name: str

    def describe(self) -> Mapping[str, Any]:
        """Return JSON-able facts for the submission's footer: name, settings, versions."""
        ...

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels.

        Args:
            pair: The image that the queries are in, the image to find them in, and the queries.

        Returns:
            One answer for every query, in order.
        """
        ...


@runtime_checkable
class KeypointMatcher(Matcher, Protocol):
    """A sparse method that also has keypoint matches of its own.

    Examples:
        >>> isinstance(pliant.open_method("sift"), pliant.baselines.matcher.KeypointMatcher)
        True
    """

    def match(self, source: Frame, target: Frame) -> Matches:
        """Return the method's own matches between two images."""
        ...


@runtime_checkable
class HeatMatcher(Matcher, Protocol):
    """A method with a heat map over the target.

    Examples:
        >>> isinstance(pliant.open_method("sift"), pliant.baselines.matcher.HeatMatcher)
        True
    """

    def heat(self, source: Frame, target: Frame, uv_a_px: npt.NDArray[np.float32]) -> Heat:
        """Return the heat map of one query.

        Args:
            source: The image the query is in.
            target: The image to find it in.
            uv_a_px: float32 (2,), the query pixel.
        """
        ...


@runtime_checkable
class RemarkingMatcher(Matcher, Protocol):
    """A method that warns about input images for which its answers are unreliable.

    Examples:
        >>> isinstance(pliant.open_method("rope-tracer"), pliant.baselines.matcher.RemarkingMatcher)
        True
    """

    def remarks(self, source: Frame, target: Frame) -> list[str]:
        """Return warnings about two images, one sentence each; empty if there are none."""
        ...


@runtime_checkable
class TrackMatcher(Matcher, Protocol):
    """A method that tracks points through the frames of an episode.

    Pairs within one episode are answered by tracking, all others by `answer`.

    Examples:
        >>> isinstance(pliant.open_method("lk-chain"), pliant.baselines.matcher.TrackMatcher)
        True
    """

    def track(self, views: Iterable[Frame], uv_px: npt.NDArray[np.float32]) -> Iterator[Answers]:
        """Track points through consecutive frames.

        Args:
            views: At least one frame, in the order of time or against it, read one by one as
                the answers are taken; the points are in the first.
            uv_px: float32 (N, 2), the points.

        Yields:
            For each frame after the first, one answer for every point, in order.
        """
        ...


@runtime_checkable
class SharingMatcher(Matcher, Protocol):
    """A method whose copies in other processes share expensive results for a picture."""

    def share(self, folder: Path) -> None:
        """Use a folder as shared cache, which exists as long as the worker processes run."""
        ...


@runtime_checkable
class SplitMatcher(Protocol):
    """A method that answers a whole split at once, without looking at images.

    Examples:
        >>> isinstance(pliant.open_method("oracle"), pliant.baselines.matcher.SplitMatcher)
        True
    """

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
