"""Methods that answer while the pointer moves, with what they can show of themselves."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from pliant.baselines.answers import checked_answers
from pliant.baselines.matcher import HeatMatcher, Matcher
from pliant.baselines.pixels import lies_on
from pliant.spec.arrays import FloatArray, Mask
from pliant.spec.frame import Frame
from pliant.spec.lru_cache import LRUCache
from pliant.spec.queries import RecordedPair
from pliant.spec.sequence import RecordedFrame
from pliant.viewer.photo_match import PointMatch, match_photo

_KEPT_MAPS: Final = 16

Kind = Literal["live", "recorded"]
"""`live` answers any pixel, `recorded` the nearest query."""

PairErrors = dict[str, list[float | None]]
"""Split -> RMSE of each pair in pixels, None where it is not known."""


@dataclass(frozen=True)
class MethodAnswer:
    """Where a method sees one point.

    Attributes:
        point: The pixel that was asked (of recorded answers, the nearest query) and the answer.
        true_px: float64 (2,), the recorded truth of a recorded answer, or None.
        confidence: 0 to 1, or None.
        confidence_is: What the confidence is; empty for none.
        material: What the method itself reads off the pixel, by the names of the material
            coordinates, or None.
        warnings: What makes the answer doubtful, in sentences.
        seconds: Time that the method took.
    """

    point: PointMatch
    true_px: FloatArray | None = None
    confidence: float | None = None
    confidence_is: str = ""
    material: Mapping[str, float] | None = None
    warnings: Sequence[str] = ()
    seconds: float = 0.0


@runtime_checkable
class DescriptorMatcher(Protocol):
    """A method with a descriptor at every pixel; it keeps those of the last few views."""

    def descriptor_map(self, view: Frame) -> npt.NDArray[np.float32]:
        """Return a view's descriptors, float32 (h, w, D)."""
        ...

    def working_mask(self, view: Frame) -> Mask | None:
        """Return a view's mask, bool (h, w), or None."""
        ...


@runtime_checkable
class CanonicalMatcher(Protocol):
    """A method that reads material coordinates off single pixels."""

    def canonical_map(self, view: Frame) -> npt.NDArray[np.float32] | None:
        """Return a view's material coordinates, float32 (h, w, 2), or None."""
        ...


class LiveMethod:
    """A method that runs while the pointer moves.

    Args:
        matcher: The method.

    Attributes:
        name: Its name.
        errors: Empty: nothing is recorded.
    """

    kind: Kind = "live"

    def __init__(self, matcher: Matcher) -> None:
        self.matcher, self.name = matcher, matcher.name
        self.errors: PairErrors = {}
        self._canonical: LRUCache[npt.NDArray[np.float32] | None] = LRUCache(_KEPT_MAPS)
        self.lock = threading.RLock()

    def answer(self, pair: RecordedPair) -> MethodAnswer | None:
        """Return the answer to the first pixel of a pair, or None off the queried object."""
        source, uv_a_px = pair.source, pair.uv_a_px[0].astype(np.float64)
        whole = np.ones(source.rgb.shape[:2], np.bool_)
        if not lies_on(pair.uv_a_px[:1], whole if source.mask is None else source.mask)[0]:
            return None
        with self.lock:
            begun = time.perf_counter()
            _one_thread()
            match = match_photo(self.matcher, source, pair.target, [(uv_a_px[0], uv_a_px[1])])
            seconds = time.perf_counter() - begun
            material = self._material(source, uv_a_px)
        point = match.points[0]
        return MethodAnswer(
            point,
            confidence=match.confidence(point),
            confidence_is=match.confidence_is(point) or "",
            material=material,
            warnings=match.warnings(),
            seconds=seconds,
        )

    def answers(self, pair: RecordedPair) -> FloatArray:
        """Return the answers to the pixels of a pair, float64 (N, 2)."""
        with self.lock:
            found = self.matcher.answer(pair)
        answers = checked_answers(found, len(pair), self.matcher.name, "this pair")
        return answers.uv_px.astype(np.float64)

    def descriptors(self, view: Frame) -> tuple[FloatArray, Mask] | None:
        """Return a view's descriptors (h, w, D) and the mask at their size, or None.

        Of a method without masks, every pixel is in the mask.
        """
        if not isinstance(self.matcher, DescriptorMatcher):
            return None
        with self.lock:
            made = self.matcher.descriptor_map(view).astype(np.float64)
            return made, self._mask(view, made.shape[0], made.shape[1])

    def canonical(self, view: Frame) -> tuple[FloatArray, Mask] | None:
        """Return the material coordinates read off each pixel (h, w, 2) and the mask, or None."""
        matcher = self.matcher
        if not isinstance(matcher, CanonicalMatcher):
            return None
        with self.lock:
            read = self._canonical.get(view.cache_key, lambda: matcher.canonical_map(view))
            if read is None:
                return None
            return read.astype(np.float64), self._mask(view, read.shape[0], read.shape[1])

    @property
    def shows(self) -> dict[str, bool]:
        """Whether there are heat maps, descriptors, material coordinates and errors of pixels."""
        network = getattr(self.matcher, "network", None)
        return {
            "heat": isinstance(self.matcher, HeatMatcher),
            "descriptors": isinstance(self.matcher, DescriptorMatcher),
            "canonical": getattr(network, "canonical", None) is not None,
            "error": True,
        }

    def _mask(self, view: Frame, height: int, width: int) -> Mask:
        mask = None
        if isinstance(self.matcher, DescriptorMatcher):
            mask = self.matcher.working_mask(view)
        return np.ones((height, width), np.bool_) if mask is None else mask

    def _material(self, source: RecordedFrame, uv_a_px: FloatArray) -> dict[str, float] | None:
        found = self.canonical(source)
        if found is None:
            return None
        read, _ = found
        height, width = source.rgb.shape[:2]
        row = int(uv_a_px[1] * read.shape[0] / height)
        column = int(uv_a_px[0] * read.shape[1] / width)
        names = (each.name for each in source.sequence.described.queried.material)
        return {name: float(m) for name, m in zip(names, read[row, column], strict=True)}


def _one_thread() -> None:
    """Let torch use one thread: on small arrays several wait for each other."""
    if "torch" in sys.modules:
        import torch

        if torch.get_num_threads() > 1:
            torch.set_num_threads(1)
