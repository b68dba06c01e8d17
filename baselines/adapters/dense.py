"""A matcher made of dense flow or a dense warp from the source to the target."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pliant.baselines.adapters.images import (
    Images,
    as_grid,
    as_probability,
    cell_centres,
    function_name,
    in_two,
    sample,
)
from pliant.spec.answers import Answers
from pliant.spec.arrays import FloatArray
from pliant.spec.frame import Frame, Pair

DenseFunction = Callable[[Any, Any], Any]
"""(source image, target image) -> a map (h, w, 2) or (2, h, w) of any resolution over the source
image, alone or with a confidence (h, w), 0 to 1."""


class DenseMatcher:
    """Answers queries by reading a dense map at their pixels.

    Args:
        function: Returns the map.
        name: Name of the method.
        images: How the function receives images.
        kind: `flow` is a displacement in px of the image that the function receives; `warp` is a
            position in the target, in `images.coordinates`.
    """

    def __init__(
        self, function: DenseFunction, name: str, images: Images, kind: Literal["flow", "warp"]
    ) -> None:
        self.name = name
        self._function, self._images, self._kind = function, images, kind

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {"implementation": f"dense {self._kind}, read bilinearly"}

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels; see `Matcher.answer`.

        Raises:
            SubmissionError: The function returned a map of another shape.
        """
        source, target, uv_a_px = pair.source, pair.target, pair.uv_a_px
        images = self._images
        found = self._function(images.image(source), images.image(target))
        mapped, confidence = in_two(found, self.name)
        grid = as_grid(mapped, 2, self.name)
        position = self._target_px(grid, source, target)
        size, target_size = source.rgb.shape[1::-1], target.rgb.shape[1::-1]
        moved = position - cell_centres(grid.shape, target_size)  # a border extrapolates as a shift
        scale = np.divide(target_size, size)
        answer = uv_a_px * scale + sample(moved, _in_cells(uv_a_px, grid, size))
        visible = None
        if confidence is not None:
            certain = as_grid(confidence, 1, self.name)
            visible = as_probability(sample(certain, _in_cells(uv_a_px, certain, size))[:, 0])
        return Answers(answer.astype(np.float32), visible)

    def _target_px(self, grid: FloatArray, source: Frame, target: Frame) -> FloatArray:
        """Return the target pixel of each cell's centre, float64 (h, w, 2)."""
        if self._kind == "warp":
            return self._images.from_function(grid, target)
        arrived = cell_centres(grid.shape, self._images.size_of(source)) + grid
        pixels: FloatArray = arrived * (target.rgb.shape[1::-1] / self._images.size_of(target))
        return pixels


def _in_cells(uv_px: npt.NDArray[Any], grid: FloatArray, size: tuple[int, ...]) -> FloatArray:
    """Return pixels of an image as columns and rows of a grid that covers it."""
    cells: FloatArray = uv_px * (np.array(grid.shape[1::-1]) / size) - 0.5
    return cells


def from_flow(
    function: DenseFunction, *, name: str | None = None, images: Images | None = None
) -> DenseMatcher:
    """Return a matcher of a function that gives optical flow.

    Args:
        function: (source image, target image) -> forward flow (h, w, 2) or (2, h, w), px of the
            image it receives, at that or a lower resolution; or a tuple of flow and confidence
            (h, w), 0 to 1, which becomes the probability that a point is visible.
        name: Name of the method; None takes the function's.
        images: How the function receives images.
    """
    return DenseMatcher(function, name or function_name(function), images or Images(), "flow")


def from_warp(
    function: DenseFunction, *, name: str | None = None, images: Images | None = None
) -> DenseMatcher:
    """Return a matcher of a function that gives a dense warp.

    Args:
        function: (source image, target image) -> target position (h, w, 2) or (2, h, w) of each
            source pixel in `images.coordinates`; or a tuple of it and confidence (h, w).
        name: Name of the method; None takes the function's.
        images: How the function receives images and counts positions.
    """
    return DenseMatcher(function, name or function_name(function), images or Images(), "warp")
