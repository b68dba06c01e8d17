"""A matcher made of a function that gives a descriptor in each cell of a grid over an image."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.adapters.images import Images, as_grid, function_name, sample
from pliant.baselines.matcher import Heat
from pliant.baselines.pixels import central_position, pixel_centres, searched_mask
from pliant.spec.answers import Answers
from pliant.spec.arrays import Float32Array, FloatArray, IntArray
from pliant.spec.errors import SubmissionError
from pliant.spec.frame import Frame, Pair
from pliant.spec.lru_cache import LRUCache

_FRAMES: Final = 4
_QUERIES_AT_ONCE: Final = 64
_TEMPERATURE: Final = 0.05
"""Of the softmax of the similarities, which gives the heat map's confidence."""

_STEPS: Final = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 2), axis=-1).reshape(-1, 2)
_LEVELS: Final = (1.0, 0.25, 0.0625)
"""Half-widths, in cells, of the squares that refinement searches, one after the other."""


class DescriptorMatcher:
    """Answers with the place whose descriptor has the largest cosine similarity.

    The best cell that touches the target's object is refined below a cell: descriptors are
    interpolated bilinearly around it, and the similarity is maximised.

    Args:
        function: Image -> map of descriptors.
        name: Name of the method.
        images: How the function receives images.
        grid: (stride, first), px of the image that the function receives: column j of the map is
            centred at first + j stride. None: cells cover the image, whatever the stride.
    """

    def __init__(
        self,
        function: Callable[[Any], Any],
        name: str,
        images: Images,
        grid: tuple[float, float] | None = None,
    ) -> None:
        self.name = name
        self._function, self._images, self._grid = function, images, grid
        self._maps: LRUCache[Float32Array] = LRUCache(_FRAMES)

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {"implementation": "dense descriptors, nearest by cosine, refined bilinearly"}

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels; see `Matcher.answer`."""
        source, target, uv_a_px = pair.source, pair.target, pair.uv_a_px
        wanted, cells = self._wanted(source, uv_a_px), self._cells(target)
        if len(cells) == 0:
            return Answers(np.tile(central_position(target), (len(uv_a_px), 1)))
        described = self._map(target)
        stride, first = self._geometry(described, target)
        found = []
        for begin in range(0, len(wanted), _QUERIES_AT_ONCE):
            part = wanted[begin : begin + _QUERIES_AT_ONCE]
            score = part @ described[cells[:, 1], cells[:, 0]].T  # (N, M)
            best = cells[score.argmax(axis=1)].astype(np.float64)
            found.append(first + _refined(described, part, best) * stride)
        uv_px = np.concatenate([np.zeros((0, 2)), *found])
        return Answers(uv_px.astype(np.float32))

    def heat(self, source: Frame, target: Frame, uv_a_px: Float32Array) -> Heat:
        """Return the cosine similarity of every target pixel; see `HeatMatcher.heat`."""
        from scipy.special import softmax

        wanted = self._wanted(source, uv_a_px[None])
        cells, described = self._cells(target), self._map(target)
        score = wanted @ described[cells[:, 1], cells[:, 0]].T
        mask = searched_mask(target)
        values = np.full(mask.shape, np.nan, np.float32)
        similarity = np.full(described.shape[:2], np.nan, np.float32)
        similarity[cells[:, 1], cells[:, 0]] = score[0]
        at = self._nearest_cell(pixel_centres(mask), described, target)
        values[mask] = similarity[at[:, 1], at[:, 0]]
        logits = (score[0] / _TEMPERATURE).astype(np.float64)
        share = float(softmax(logits).max()) if len(cells) else 0.0
        return Heat(values, "cosine similarity", share, "probability of the best cell")

    def _map(self, view: Frame) -> Float32Array:
        """Return a view's descriptors, float32 (h, w, D), of length 1."""
        return self._maps.get(view.cache_key, lambda: self._described(view))

    def _described(self, view: Frame) -> Float32Array:
        found = self._function(self._images.image(view))
        sizes = (view.rgb.shape[1::-1], self._images.size_of(view))
        grid = as_grid(found, None, self.name, sizes)
        if not np.isfinite(grid).all():
            raise SubmissionError(
                f"the method {self.name!r} returned descriptors that are not finite",
                found=f"{np.count_nonzero(~np.isfinite(grid))} of {grid.size} values",
            )
        return _unit(grid.astype(np.float32))

    def _wanted(self, source: Frame, uv_px: npt.NDArray[Any]) -> Float32Array:
        """Return the descriptors of source pixels, float32 (N, D)."""
        described = self._map(source)
        stride, first = self._geometry(described, source)
        return _unit(sample(described, (uv_px - first) / stride))

    def _geometry(self, described: npt.NDArray[Any], view: Frame) -> tuple[FloatArray, FloatArray]:
        """Return stride and first centre of the cells, each (2,), px of the view."""
        size = np.array(view.rgb.shape[1::-1], np.float64)
        if self._grid is None:
            stride = size / described.shape[1::-1]
            return stride, stride / 2
        scale = size / self._images.size_of(view)
        return self._grid[0] * scale, self._grid[1] * scale

    def _nearest_cell(
        self, uv_px: Float32Array, described: npt.NDArray[Any], view: Frame
    ) -> IntArray:
        stride, first = self._geometry(described, view)
        last = np.array(described.shape[1::-1]) - 1
        return np.clip(np.rint((uv_px - first) / stride), 0, last).astype(np.int64)

    def _cells(self, view: Frame) -> IntArray:
        """Return column and row of the cells that touch the object, int64 (M, 2)."""
        described = self._map(view)
        on = np.zeros(described.shape[:2], np.bool_)
        at = self._nearest_cell(pixel_centres(searched_mask(view)), described, view)
        on[at[:, 1], at[:, 0]] = True
        return np.argwhere(on)[:, ::-1]


def _unit(values: npt.NDArray[Any]) -> Float32Array:
    length = np.linalg.norm(values, axis=-1, keepdims=True)
    return (values / np.maximum(length, 1e-12)).astype(np.float32)


def _refined(described: Float32Array, wanted: Float32Array, at: FloatArray) -> FloatArray:
    """Return where, within a cell of the best cells, interpolated descriptors agree best.

    Args:
        described: float32 (h, w, D), of length 1.
        wanted: float32 (N, D), of length 1.
        at: float64 (N, 2), column and row.
    """
    last = np.array(described.shape[1::-1]) - 1
    for reach in _LEVELS:
        tried = np.clip(at[:, None] + reach * _STEPS, 0, last)  # (N, S, 2)
        score = (_unit(sample(described, tried)) @ wanted[..., None])[..., 0]
        at = tried[np.arange(len(at)), score.argmax(axis=1)]
    return at


def from_descriptors(
    function: Callable[[Any], Any],
    *,
    name: str | None = None,
    images: Images | None = None,
    grid: tuple[float, float] | None = None,
) -> DescriptorMatcher:
    """Return a matcher of a function that gives a map of descriptors.

    Args:
        function: Image -> descriptors, an array (h, w, D) or a tensor (D, h, w), of any stride.
        name: Name of the method; None takes the function's.
        images: How the function receives images.
        grid: (stride, first): where the cells are; see `DescriptorMatcher`.
    """
    return DescriptorMatcher(function, name or function_name(function), images or Images(), grid)
