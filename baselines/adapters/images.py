"""Conversion of the inputs and outputs of a user's function: images, positions, maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.baselines.answers import to_array
from pliant.spec.arrays import Float32Array, FloatArray, Rgb
from pliant.spec.calls import check_type, check_whole
from pliant.spec.errors import CallError, MissingExtraError, SubmissionError
from pliant.spec.frame import Frame

Coordinates = Literal["pixel", "index", "normalised"]

_ROUNDING: Final = 1e-3
"""Of a network in half precision."""


@dataclass(frozen=True)
class Images:
    """How a function receives images, and how it counts positions in them.

    Attributes:
        size: (width, height), px, that images are resized to; None leaves them.
        multiple: Sides are rounded up to a multiple of this, and the image resized to them.
        device: None gives uint8 arrays (H, W, 3), sRGB; the name of a torch device gives float32
            tensors (1, 3, H, W) there, values 0 to 1.
        coordinates: Positions given to and returned by the function: `pixel` has the centre of
            the first pixel at (0.5, 0.5); `index` has it at (0, 0), as array indices and OpenCV;
            `normalised` goes from -1 to 1 between the outer edges of the image, as
            `torch.nn.functional.grid_sample(align_corners=False)`.
    """

    size: tuple[int, int] | None = None
    multiple: int = 1
    device: str | None = None
    coordinates: Coordinates = "pixel"

    def __post_init__(self) -> None:
        if self.coordinates not in ("pixel", "index", "normalised"):
            raise CallError(
                "this is not a convention of coordinates",
                where="coordinates",
                found=repr(self.coordinates),
                required="pixel, index or normalised",
            )
        check_whole("multiple", self.multiple, 1)
        if self.size is not None:
            check_type("size", self.size, (tuple, list), required="(width, height)")
            if len(self.size) != 2:
                raise CallError("the size is wrong", found=self.size, required="(width, height)")
            for side in self.size:
                check_whole("size", side, 1)

    def size_of(self, view: Frame) -> FloatArray:
        """Return the width and height that the function sees, float64 (2,), px."""
        given = np.array(self.size or view.rgb.shape[1::-1])
        return (np.ceil(given / self.multiple) * self.multiple).astype(np.float64)

    def image(self, view: Frame) -> Any:
        """Return a view's image as the function receives it.

        Raises:
            MissingExtraError: A device is named, and torch is not installed.
        """
        return self.images([view])[0] if self.device is None else self.images([view])

    def images(self, views: list[Frame]) -> Any:
        """Return images of one size as (T, H, W, 3) uint8, or (T, 3, H, W) float32 on the device.

        Raises:
            MissingExtraError: A device is named, and torch is not installed.
        """
        stacked = np.stack([_resized(view.rgb, self.size_of(view)) for view in views])
        if self.device is None:
            return stacked
        try:
            import torch
        except ImportError as error:
            raise MissingExtraError("a method on a torch device", "train") from error
        tensor = torch.from_numpy(stacked).to(self.device)
        return tensor.permute(0, 3, 1, 2).to(torch.float32) / 255

    def to_function(self, uv_px: npt.NDArray[Any], view: Frame) -> Float32Array:
        """Return pixels of a view as the function counts them, float32 (N, 2)."""
        size = self.size_of(view)
        position = np.asarray(uv_px, np.float64) * (size / view.rgb.shape[1::-1])
        if self.coordinates == "index":
            position = position - 0.5
        elif self.coordinates == "normalised":
            position = 2 * position / size - 1
        return position.astype(np.float32)

    def from_function(self, position: npt.NDArray[Any], view: Frame) -> FloatArray:
        """Return the pixels of a view for positions as the function counts them, (..., 2)."""
        size = self.size_of(view)
        found = np.asarray(position, np.float64)
        if self.coordinates == "index":
            found = found + 0.5
        elif self.coordinates == "normalised":
            found = (found + 1) / 2 * size
        pixels: FloatArray = found * (view.rgb.shape[1::-1] / size)
        return pixels


def _resized(rgb: Rgb, size: FloatArray) -> Rgb:
    """Resize by Pillow's bilinear filter, which averages when an image becomes smaller."""
    width, height = (int(side) for side in size)
    if rgb.shape[:2] == (height, width):
        return rgb
    return np.array(Image.fromarray(rgb).resize((width, height), Image.Resampling.BILINEAR))


def function_name(function: Callable[..., Any]) -> str:
    """Return a function's own name, that of the function in a partial call, or its class's."""
    function = getattr(function, "func", function)
    return str(getattr(function, "__name__", type(function).__name__))


def in_two(found: Any, method: str) -> tuple[Any, Any]:
    """Return what a function gave, and the second part if it gave a tuple, else None.

    Raises:
        SubmissionError: The tuple has another number of parts.
    """
    if not isinstance(found, tuple):
        return found, None
    if len(found) != 2:
        raise SubmissionError(
            f"the method {method!r} returned a tuple of another length",
            found=len(found),
            required="one array, or two: positions, and a confidence or visibility",
        )
    return found


def as_grid(
    values: Any, channels: int | None, method: str, sizes: Sequence[npt.ArrayLike] = ()
) -> FloatArray:
    """Return a map as float64 (h, w, C).

    Args:
        values: (h, w, C) or (C, h, w), with or without a batch dimension of 1, array or tensor.
        channels: C; None reads the map in the order in which it has the proportions of an image,
            and where both orders do, a tensor as (C, h, w) and an array as (h, w, C).
        method: Name of the method, for messages.
        sizes: Width and height of the images that the map may be of; needed where C is None.

    Raises:
        SubmissionError: It has another shape.
    """
    grid = to_array(values)
    if grid.ndim == 4 and len(grid) == 1:
        grid = grid[0]
    if grid.ndim == 2 and channels == 1:
        grid = grid[..., None]
    if channels is None and grid.ndim == 3 and grid.size:
        last_off, first_off = (_off(cells, sizes) for cells in (grid.shape[:2], grid.shape[1:]))
        first = first_off < last_off or (first_off == last_off and hasattr(values, "detach"))
    else:
        first = grid.shape[-1:] != (channels,)
    if grid.ndim != 3 or channels not in (None, grid.shape[0 if first else -1]):
        size = "C" if channels is None else channels
        raise SubmissionError(
            f"the method {method!r} returned no map",
            found=f"shape {to_array(values).shape}",
            required=f"(h, w, {size}) or ({size}, h, w)",
        )
    return (np.moveaxis(grid, 0, 2) if first else grid).astype(np.float64)


def _off(cells: Sequence[int], sizes: Sequence[npt.ArrayLike]) -> float:
    """Return by how much the proportions of a grid differ from the nearest of those of images."""
    rows, columns = cells
    return min(
        abs(float(np.log(rows * width / (columns * height))))
        for width, height in map(np.asarray, sizes)
    )


def as_probability(values: FloatArray) -> Float32Array:
    """Return values that pass 0 or 1 by rounding as 0 or 1, and others unchanged.

    The loop refuses logits and percentages, which clipping would make certain.
    """
    clipped = np.clip(values, 0, 1)
    return np.where(np.abs(values - clipped) < _ROUNDING, clipped, values).astype(np.float32)


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
