"""A matcher from any local feature: dense descriptors for answers, keypoints for matches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, Protocol

import numpy as np
import numpy.typing as npt

from pliant.baselines.matcher import Heat
from pliant.baselines.pixels import central_position, lies_on, luma, pixel_centres, searched_mask
from pliant.spec.answers import Answers, Matches
from pliant.spec.arrays import BoolArray, Float32Array, ImageArray, IntArray
from pliant.spec.frame import Frame, Pair
from pliant.spec.lru_cache import LRUCache

Metric = Literal["euclidean", "hamming"]

Descriptors = npt.NDArray[Any]
"""float32 (N, D) for `euclidean`; uint8 (N, D) of packed bits for `hamming`."""

ROWS_AT_ONCE: Final = 256
"""Queries that are compared in one matrix product; bounds the memory."""


def distances(a: Descriptors, b: Descriptors, metric: Metric) -> Float32Array:
    """Return all distances between two sets of descriptors.

    Both are computed as |a|² + |b|² - 2 a·b. For integer-valued descriptors (SIFT as OpenCV
    gives it, and bits) every term is below 2²⁴, so float32 holds it exactly and the result
    does not depend on the order of summation.

    Args:
        a: (N, D) descriptors.
        b: (M, D) descriptors.
        metric: `euclidean` gives |a - b|; `hamming` the number of differing bits.

    Returns:
        float32 (N, M).
    """
    if metric == "hamming":
        a, b = np.unpackbits(a, axis=1), np.unpackbits(b, axis=1)
    a = a.astype(np.float32, copy=False)
    b = b.astype(np.float32, copy=False)
    squared = (a * a).sum(axis=1)[:, None] + (b * b).sum(axis=1)[None, :] - 2 * (a @ b.T)  # (N, M)
    np.maximum(squared, 0, out=squared)
    return squared if metric == "hamming" else np.sqrt(squared)


def nearest(
    queries: Descriptors, candidates: Descriptors, metric: Metric
) -> tuple[IntArray, BoolArray]:
    """Return the nearest candidate of each query, and whether the choice means anything.

    Args:
        queries: (N, D) descriptors.
        candidates: (M, D) descriptors, M >= 1.
        metric: Distance.

    Returns:
        The row of the nearest candidate, int64 (N,), the first one among equals; and bool
        (N,), False where all candidates are equally far (a blank image, a single candidate).
    """
    row = np.zeros(len(queries), dtype=np.int64)
    decided = np.zeros(len(queries), dtype=np.bool_)
    for start in range(0, len(queries), ROWS_AT_ONCE):
        part = slice(start, start + ROWS_AT_ONCE)
        distance = distances(queries[part], candidates, metric)  # (<= ROWS_AT_ONCE, M)
        row[part] = distance.argmin(axis=1)
        decided[part] = distance.min(axis=1) < distance.max(axis=1)
    return row, decided


def ratio_test(
    a: Descriptors, b: Descriptors, metric: Metric, ratio: float
) -> tuple[IntArray, IntArray, Float32Array]:
    """Match by Lowe's ratio test (IJCV 2004, section 7.1).

    A descriptor of `a` is matched to its nearest of `b` where the nearest distance is below
    `ratio` times the second nearest. With fewer than two candidates there is no second
    nearest, hence no match.

    Args:
        a: (N, D) descriptors of the source.
        b: (M, D) descriptors of the target.
        metric: Distance.
        ratio: Threshold, in (0, 1].

    Returns:
        Rows of `a` and rows of `b` of the K matches, int64 (K,) each, ascending in `a`; and
        their score, float32 (K,): 1 - nearest / second nearest.
    """
    none = np.zeros(0, dtype=np.int64)
    if len(a) == 0 or len(b) < 2:
        return none, none, np.zeros(0, dtype=np.float32)
    rows_a, rows_b, scores = [none], [none], [np.zeros(0, dtype=np.float32)]
    for start in range(0, len(a), ROWS_AT_ONCE):
        distance = distances(a[start : start + ROWS_AT_ONCE], b, metric)
        best = distance.argmin(axis=1)  # the first one among equals
        row = np.arange(len(distance))
        first = distance[row, best]
        distance[row, best] = np.inf
        second = distance.min(axis=1)
        kept = np.nonzero(first < np.float32(ratio) * second)[0]
        rows_a.append(kept + start)
        rows_b.append(best[kept])
        scores.append(1 - first[kept] / second[kept])
    return np.concatenate(rows_a), np.concatenate(rows_b), np.concatenate(scores)


LOWE_RATIO: Final = 0.8
"""Nearest over second-nearest distance below which a keypoint match is kept."""

DENSE_LIMIT: Final = 20_000
"""Descriptors computed over a target at most; the grid's stride follows from it."""

SMALLEST_SIDE_PX: Final = 32
"""An image with a shorter side has no keypoints: the detectors' pyramids do not fit into it."""

RIVAL_RADIUS_PX: Final = 16.0
"""A second place nearer than this to the answer is not a rival but its neighbour."""


@dataclass(frozen=True)
class Keypoints:
    """What a detector found.

    Attributes:
        uv_px: float32 (N, 2), Pliant's pixel convention.
        descriptors: (N, D).
    """

    uv_px: Float32Array
    descriptors: Descriptors


class LocalFeatures(Protocol):
    """A detector and descriptor of image patches."""

    name: str
    metric: Metric

    def facts(self) -> Mapping[str, Any]:
        """Return settings and versions for the submission's footer."""
        ...

    def detect(self, grey: ImageArray) -> Keypoints:
        """Find and describe the image's own keypoints.

        Args:
            grey: uint8 (H, W).
        """
        ...

    def describe_at(self, grey: ImageArray, uv_px: Float32Array) -> Descriptors:
        """Describe the patches around given positions.

        Args:
            grey: uint8 (H, W).
            uv_px: float32 (N, 2), inside the image.

        Returns:
            (N, D), a row for every position.
        """
        ...


@dataclass(frozen=True)
class _Dense:
    uv_px: Float32Array  # (G, 2)
    descriptors: Descriptors  # (G, D)
    stride: int


def dense_stride(pixels: int, limit: int) -> int:
    """Return the smallest grid stride that leaves at most `limit` of a mask's pixels.

    Args:
        pixels: Pixels of the mask.
        limit: Descriptors that may be computed.
    """
    stride = 1
    while pixels > limit * stride * stride:
        stride += 1
    return stride


class LocalFeatureMatcher:
    """Answers queries, and matches keypoints, with a local feature.

    An answer is the place on the target's object whose descriptor is nearest to the query
    pixel's, among all pixels (or, where the object has more than `DENSE_LIMIT`, a
    grid of every second, third … row and column). A query that nothing distinguishes (a blank
    image, an empty mask) is answered by the mask's centroid or the image's centre.

    Keypoint matches follow the method's own detector: keypoints on the object in both
    images, nearest neighbour, Lowe's ratio test; the score is 1 - ratio.

    Args:
        features: The local feature.
    """

    def __init__(self, features: LocalFeatures) -> None:
        self.name = features.name
        self._features = features
        self._dense: LRUCache[_Dense] = LRUCache(4)
        self._keypoints: LRUCache[Keypoints] = LRUCache(8)

    def describe(self) -> Mapping[str, Any]:
        """Return name, settings and versions for the submission's footer."""
        return {
            "name": self.name,
            **self._features.facts(),
            "ratio": LOWE_RATIO,
            "dense_limit": DENSE_LIMIT,
            "without_a_choice": "centroid of the mask, or the image's centre",
        }

    def answer(self, pair: Pair) -> Answers:
        """Answer each query by the nearest descriptor on the target's object.

        Args:
            pair: The images and the queries.

        Returns:
            Positions alone: pixel centres of the target.
        """
        source, target, uv_a_px = pair.source, pair.target, pair.uv_a_px
        uv_b_px = np.tile(central_position(target), (len(uv_a_px), 1))  # (N, 2)
        if len(uv_a_px) == 0:
            return Answers(uv_px=uv_b_px)
        dense = self._dense_of(target)
        if len(dense.uv_px):
            queries = self._features.describe_at(luma(source.rgb), uv_a_px)
            row, decided = nearest(queries, dense.descriptors, self._features.metric)
            uv_b_px[decided] = dense.uv_px[row[decided]]
        return Answers(uv_px=uv_b_px)

    def match(self, source: Frame, target: Frame) -> Matches:
        """Match the method's own keypoints by the ratio test.

        Args:
            source: First image.
            target: Second image.

        Returns:
            The matches that pass, in the order of the source's keypoints.
        """
        a, b = self._keypoints_of(source), self._keypoints_of(target)
        row_a, row_b, score = ratio_test(
            a.descriptors, b.descriptors, self._features.metric, LOWE_RATIO
        )
        return Matches(uv_a_px=a.uv_px[row_a], uv_b_px=b.uv_px[row_b], score=score)

    def heat(self, source: Frame, target: Frame, uv_a_px: Float32Array) -> Heat:
        """Return how alike each place of the target is to the query.

        Args:
            source: The image the query is in.
            target: The image to find it in.
            uv_a_px: float32 (2,).

        Returns:
            Minus the descriptor distance; the confidence is 1 - nearest / nearest rival, a
            rival being at least `RIVAL_RADIUS_PX` away.
        """
        dense = self._dense_of(target)
        values = np.full(target.rgb.shape[:2], np.nan, dtype=np.float32)
        confidence = 0.0
        if len(dense.uv_px):
            query = self._features.describe_at(luma(source.rgb), uv_a_px.reshape(1, 2))
            distance = distances(query, dense.descriptors, self._features.metric)[0]  # (G,)
            _paint(values, dense, -distance, searched_mask(target))
            best = dense.uv_px[distance.argmin()]
            away = np.hypot(*(dense.uv_px - best).T) >= RIVAL_RADIUS_PX
            rival = distance[away].min() if away.any() else np.float32(0)
            confidence = float(1 - distance.min() / rival) if rival > 0 else 0.0
        unit = "bits" if self._features.metric == "hamming" else "descriptor units"
        return Heat(
            values=values,
            label=f"similarity: minus the distance, {unit}",
            confidence=confidence,
            confidence_label=(
                f"1 - best / second-best distance at least {RIVAL_RADIUS_PX:.0f} px away"
            ),
        )

    def _dense_of(self, view: Frame) -> _Dense:
        def make() -> _Dense:
            mask = searched_mask(view)
            stride = dense_stride(int(mask.sum()), DENSE_LIMIT)
            uv_px = pixel_centres(mask, stride)
            return _Dense(uv_px, self._features.describe_at(luma(view.rgb), uv_px), stride)

        return self._dense.get(view.cache_key, make)

    def _keypoints_of(self, view: Frame) -> Keypoints:
        def make() -> Keypoints:
            if min(view.rgb.shape[:2]) < SMALLEST_SIDE_PX:
                nothing = self._features.describe_at(luma(view.rgb), np.zeros((0, 2), np.float32))
                return Keypoints(np.zeros((0, 2), np.float32), nothing)
            found = self._features.detect(luma(view.rgb))
            kept = lies_on(found.uv_px, searched_mask(view))
            return Keypoints(found.uv_px[kept], found.descriptors[kept])

        return self._keypoints.get(view.cache_key, make)


def _paint(values: Float32Array, dense: _Dense, score: Float32Array, mask: BoolArray) -> None:
    """Spread a grid's scores over the blocks of pixels they stand for, inside the mask."""
    column, row = np.floor(dense.uv_px).astype(np.int64).T
    first = -(dense.stride // 2)
    for down in range(first, first + dense.stride):
        for right in range(first, first + dense.stride):
            y = np.clip(row + down, 0, values.shape[0] - 1)
            x = np.clip(column + right, 0, values.shape[1] - 1)
            values[y, x] = score
    values[~mask] = np.nan
