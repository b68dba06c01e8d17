"""How a user's function receives images and gives positions: sizes, tensors, half pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.spec.arrays import FloatArray
from pliant.spec.errors import CallError, MissingExtraError
from pliant.spec.frame import Frame

Coordinates = Literal["pixel", "index", "normalised"]


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

    def to_function(self, uv_px: npt.NDArray[Any], view: Frame) -> npt.NDArray[np.float32]:
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


def to_array(values: Any) -> npt.NDArray[Any]:
    """Return an array-like or a torch tensor, on whatever device, as an array."""
    if hasattr(values, "detach"):
        values = values.detach().cpu().float().numpy()
    return np.asarray(values)


def _resized(rgb: npt.NDArray[np.uint8], size: FloatArray) -> npt.NDArray[np.uint8]:
    """Resize by Pillow's bilinear filter, which averages when an image becomes smaller."""
    width, height = (int(side) for side in size)
    if rgb.shape[:2] == (height, width):
        return rgb
    return np.array(Image.fromarray(rgb).resize((width, height), Image.Resampling.BILINEAR))
