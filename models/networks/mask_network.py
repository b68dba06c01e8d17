"""A small network that finds a rope and its ball, or a cloth, in a picture."""

from __future__ import annotations

from typing import Any, Final

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


class MaskNetwork(UNet):
    """Logits of the object and of object or ball, float (N, 2, h, w), of pictures (N, 3, h, w)."""

    def __init__(self) -> None:
        super().__init__(3, 2, widths=(16, 32, 48, 64), global_blocks=1, patch=2)

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
