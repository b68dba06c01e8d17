"""A matcher made of sparse matches: queries are interpolated between them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from pliant.baselines.adapters.images import Images, function_name
from pliant.baselines.answers import checked_matches
from pliant.baselines.pixels import central_position
from pliant.spec.answers import Answers, Matches
from pliant.spec.arrays import FloatArray
from pliant.spec.calls import check_whole
from pliant.spec.frame import Frame, Pair

_RIDGE: Final = 1e-3
"""Weight that pulls the local map towards a pure shift, where the matches leave it open (a line
of matches along a rope says nothing across it)."""

_REWEIGHTINGS: Final = 3
_SCALE_FLOOR_PX: Final = 0.5


class SparseMatcher:
    """Answers queries by interpolating matches. A pair without matches gets the object's middle.

    Args:
        match: (source view, target view) -> `Matches`, or arrays (M, 2), (M, 2) and where there
            are scores (M,), pixels.
        name: Name of the method.
        neighbours: Matches that a local affine map is fitted to, >= 1; see `interpolate`.
        facts: JSON-able facts of the method.
    """

    def __init__(
        self,
        match: Callable[[Frame, Frame], Any],
        name: str,
        neighbours: int = 8,
        facts: Mapping[str, Any] | None = None,
    ) -> None:
        check_whole("neighbours", neighbours, 1)
        self.name = name
        self._match = match
        self._neighbours = neighbours
        self._facts = facts or {}

    def describe(self) -> Mapping[str, Any]:
        """Return the facts of the method, and how queries follow from its matches."""
        many = self._neighbours > 1
        how = f"affine, {self._neighbours} nearest matches" if many else "nearest match"
        return {**self._facts, "interpolation": how}

    def match(self, source: Frame, target: Frame) -> Matches:
        """Return the method's own matches.

        Raises:
            SubmissionError: The function did not return matches.
        """
        return checked_matches(self._match(source, target), self.name)

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels; see `Matcher.answer`."""
        matches = self.match(pair.source, pair.target)
        if len(matches.score) == 0:
            return Answers(np.tile(central_position(pair.target), (len(pair.uv_a_px), 1)))
        found = interpolate(
            matches.uv_a_px.astype(np.float64),
            matches.uv_b_px.astype(np.float64),
            pair.uv_a_px.astype(np.float64),
            self._neighbours,
        )
        return Answers(found.astype(np.float32))


def match_images(
    function: Callable[[Any, Any], Any], images: Images, name: str, source: Frame, target: Frame
) -> Matches:
    """Return the matches of two views by a function of two images.

    Args:
        function: (source image, target image) -> matches as `checked_matches` takes them.
        images: How the function receives images and counts positions.
        name: Name of the method, for messages.
        source: The first view.
        target: The second view.
    """
    found = function(images.image(source), images.image(target))
    matches = checked_matches(found, name, index=images.coordinates == "index")
    return Matches(
        images.from_function(matches.uv_a_px, source).astype(np.float32),
        images.from_function(matches.uv_b_px, target).astype(np.float32),
        matches.score,
    )


def from_sparse(
    function: Callable[[Any, Any], Any],
    *,
    name: str | None = None,
    neighbours: int = 8,
    images: Images | None = None,
) -> SparseMatcher:
    """Return a matcher of a function that finds matches between two images.

    Args:
        function: (source image, target image) -> positions (M, 2) in the source, positions (M, 2)
            in the target and, where there are scores, (M,).
        name: Name of the method; None takes the function's.
        neighbours: Matches that a local affine map is fitted to; 1 moves a query as its nearest
            match.
        images: How the function receives images and counts positions.
    """
    name = name or function_name(function)
    match = functools.partial(match_images, function, images or Images(), name)
    return SparseMatcher(match, name, neighbours, facts={"implementation": "sparse matches"})


def interpolate(
    uv_a_px: FloatArray, uv_b_px: FloatArray, queries_px: FloatArray, neighbours: int
) -> FloatArray:
    """Return where queries are, given matches, by robust affine maps of the nearest ones.

    Args:
        uv_a_px: float64 (M, 2), M >= 1, matches in the source.
        uv_b_px: float64 (M, 2), the same in the target.
        queries_px: float64 (N, 2), in the source.
        neighbours: Matches that a map is fitted to; 1 moves a query as its nearest match.

    Returns:
        float64 (N, 2), in the target.
    """
    from scipy.spatial import cKDTree

    uv_a_px, first = np.unique(uv_a_px, axis=0, return_index=True)
    moved = uv_b_px[first] - uv_a_px
    count = min(neighbours, len(uv_a_px))
    if count < 2:
        nearest = cKDTree(uv_a_px).query(queries_px)[1]
        return queries_px + moved[nearest]
    distance, index = cKDTree(uv_a_px).query(queries_px, k=count)  # (N, k)
    return queries_px + _affine(uv_a_px[index] - queries_px[:, None], moved[index], distance)


def _affine(offset: FloatArray, moved: FloatArray, distance: FloatArray) -> FloatArray:
    """Return the displacement at the origin of local affine fits, by Cauchy reweighting.

    Args:
        offset: float64 (N, k, 2), matches relative to the query.
        moved: float64 (N, k, 2), their displacements.
        distance: float64 (N, k), lengths of `offset`.

    Returns:
        float64 (N, 2).
    """
    reach = np.maximum(distance[:, -1:], 1e-6)  # (N, 1)
    near = np.exp(-0.5 * (2 * distance / reach) ** 2)
    terms = np.concatenate([np.ones_like(offset[..., :1]), offset / reach[..., None]], axis=2)
    ridge = np.diag([0.0, _RIDGE, _RIDGE])
    weight, solved = near, np.zeros((len(offset), 3, 2))
    for _ in range(_REWEIGHTINGS):
        weighted = terms * weight[..., None]  # (N, k, 3)
        matrix = weighted.transpose(0, 2, 1) @ terms
        matrix += ridge * weight.sum(axis=1)[:, None, None]
        solved = np.linalg.solve(matrix, weighted.transpose(0, 2, 1) @ moved)
        residual = np.linalg.norm(moved - terms @ solved, axis=2)
        scale = np.maximum(1.5 * np.median(residual, axis=1, keepdims=True), _SCALE_FLOOR_PX)
        weight = near / (1 + (residual / scale) ** 2)
    shift: FloatArray = solved[:, 0]
    return shift
