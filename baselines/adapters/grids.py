"""Maps with a value in each cell of a grid over an image: layout, places of cells, sampling."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.baselines.adapters.images import to_array
from pliant.spec.arrays import FloatArray
from pliant.spec.errors import SubmissionError


def as_grid(values: Any, channels: int | None, method: str) -> FloatArray:
    """Return a map as float64 (h, w, C).

    Args:
        values: (h, w, C) or (C, h, w), with or without a batch dimension of 1, array or tensor.
        channels: C where it is known; None takes a tensor as (C, h, w) and an array as (h, w, C).
        method: Name of the method, for messages.

    Raises:
        SubmissionError: It has another shape.
    """
    grid = to_array(values)
    if grid.ndim == 4 and len(grid) == 1:
        grid = grid[0]
    if grid.ndim == 2 and channels == 1:
        grid = grid[..., None]
    first = hasattr(values, "detach") if channels is None else grid.shape[-1:] != (channels,)
    if grid.ndim != 3 or channels not in (None, grid.shape[0 if first else -1]):
        size = "C" if channels is None else channels
        raise SubmissionError(
            f"the method {method!r} returned no map",
            found=f"shape {to_array(values).shape}",
            required=f"(h, w, {size}) or ({size}, h, w)",
        )
    return (np.moveaxis(grid, 0, 2) if first else grid).astype(np.float64)


def cell_centres(shape: Sequence[int], size: npt.ArrayLike) -> FloatArray:
    """Return the centres of a grid's cells that cover an image, float64 (h, w, 2), px.

    Args:
        shape: Rows and columns of the grid, h and w; what follows is not looked at.
        size: Width and height of the image, px.
    """
    height, width = shape[:2]
    v, u = np.mgrid[0:height, 0:width] + 0.5
    return np.stack([u, v], axis=2) * (np.asarray(size) / [width, height])


def sample(grid: npt.NDArray[Any], at: FloatArray) -> npt.NDArray[Any]:
    """Return bilinear values of a map; beyond the outer cell centres, those of the border.

    Args:
        grid: float (h, w, C).
        at: float64 (..., 2), column and row, the centre of the first cell at (0, 0).

    Returns:
        float (..., C).
    """
    last = np.array(grid.shape[1::-1]) - 1
    at = np.clip(at, 0, last)
    low = np.minimum(np.floor(at).astype(np.int64), np.maximum(last - 1, 0))
    high = np.minimum(low + 1, last)
    x, y = (at - low)[..., :1].astype(grid.dtype), (at - low)[..., 1:].astype(grid.dtype)
    upper = grid[low[..., 1], low[..., 0]] * (1 - x) + grid[low[..., 1], high[..., 0]] * x
    lower = grid[high[..., 1], low[..., 0]] * (1 - x) + grid[high[..., 1], high[..., 0]] * x
    values: npt.NDArray[Any] = upper * (1 - y) + lower * y
    return values
