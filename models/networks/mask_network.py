"""A small network that finds a rope and its ball, or a cloth, in a picture.

A wider network starts with the function of a narrow one (Net2Net, arXiv 1511.05641, section 3.1):
training it from there keeps what the narrow one has learned.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, Self

import cv2
import numpy as np
import numpy.typing as npt
import torch

from pliant.models.networks.unet import UNet
from pliant.spec.arrays import Float32Array, Rgb
from pliant.spec.io.resizing import with_longer_side

MASKS: Final = "masks.safetensors"
"""The weights of a run's `MaskNetwork`."""

ROPE_SIDE: Final = 640
"""Pixels of the longer side of a picture in which a rope is looked for."""

CLOTH_SIDE: Final = 320
"""The same for a cloth, which has no thin parts, and of which all has to be seen at once."""

NARROW: Final = (16, 32, 48, 64)
WIDE: Final = (16, 64, 96, 128)
"""Channels of the levels of a `MaskNetwork`, finest first."""


class MaskNetwork(UNet):
    """Logits of the object and of object or ball, float (N, 2, h, w), of pictures (N, 3, h, w)."""

    def __init__(self, widths: Sequence[int] = NARROW) -> None:
        super().__init__(3, 2, widths=widths, global_blocks=1, patch=2)

    @classmethod
    def like(cls, weights: Mapping[str, torch.Tensor]) -> Self:
        """Return a network of the size of stored weights, which are not loaded."""
        second = weights.get("encoder.1.conv1.weight", ())
        return cls(WIDE if len(second) == WIDE[1] else NARROW)

    def widened(self) -> MaskNetwork:
        """Return a network with twice the channels at some of the levels that finds the same.

        Every channel is there twice, and both copies together have the weight of the one. Copies
        differ by noise that cancels, since copies that are alike would stay alike in training.
        """
        wide = MaskNetwork(WIDE)
        given, shapes = self.state_dict(), {k: v.shape for k, v in wide.state_dict().items()}
        weights = {name: _wider(values, shapes[name]) for name, values in given.items()}
        for name, values in weights.items():
            if ".qkv." in name and values.shape != given[name].shape:
                # Twice as many channels double the products of queries and keys; attention divides
                # them by the square root of that number.
                values[: 2 * len(values) // 3] *= 2**-0.25
        wide.load_state_dict(weights)
        return wide

    def found(self, rgb: Rgb, side: int = ROPE_SIDE) -> Float32Array:
        """Return the probabilities of a picture at the size that the network sees.

        Args:
            rgb: uint8 (H, W, 3), sRGB.
            side: Its longer side there, as in training, pixels.

        Returns:
            float32 (2, h, w), 0 to 1: that a pixel shows the object, and that or its ball.
        """
        picture = torch.from_numpy(at_side(rgb.astype(np.float32) / 255, side))
        with torch.inference_mode():
            logits = self(picture.permute(2, 0, 1)[None])[0]
            return np.asarray(logits.sigmoid().numpy(), dtype=np.float32)


def at_side(image: npt.NDArray[Any], side: int) -> npt.NDArray[Any]:
    """Return an image (H, W, C) resized to a number of pixels along its longer side."""
    height, width = with_longer_side(image.shape, side)
    if (height, width) == image.shape[:2]:
        return image
    how = cv2.INTER_AREA if width < image.shape[1] else cv2.INTER_LINEAR
    return cv2.resize(image, (width, height), interpolation=how)


_UNLIKE: Final = 0.3  # standard deviation of what copies differ by, of that of the weights


def _wider(weights: torch.Tensor, shape: torch.Size) -> torch.Tensor:
    """Return a parameter (outputs, inputs, …) with twice as many outputs, inputs or both."""
    if shape[0] == 2 * len(weights):
        weights = weights.repeat_interleave(2, dim=0)
    if weights.shape == shape:
        return weights
    copied = shape[1] - weights.shape[1]  # a decoder's inputs: first the copied ones of below
    noise = _UNLIKE * weights.std() * torch.randn_like(weights[:, :copied])
    half = weights[:, :copied] / 2
    twice = torch.stack([half + noise, half - noise], dim=2).flatten(1, 2)
    return torch.cat([twice, weights[:, copied:]], dim=1)
