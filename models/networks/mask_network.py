"""A small network that finds a rope and its ball in a picture."""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt
import torch

from pliant.models.networks.unet import UNet

MASKS: Final = "masks.safetensors"
"""The weights of a run's `MaskNetwork`."""

_WIDTH: Final = 640


class MaskNetwork(UNet):
    """Logits of the rope and of rope or ball, float (N, 2, h, w), of pictures (N, 3, h, w)."""

    def __init__(self) -> None:
        super().__init__(3, 2, widths=(16, 32, 48, 64), global_blocks=1, patch=2)

    def found(self, rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
        """Return the probabilities of a picture at the width that the network sees.

        Args:
            rgb: uint8 (H, W, 3), sRGB.

        Returns:
            float32 (2, h, 640), 0 to 1: that a pixel shows the rope, and the rope or its ball.
        """
        picture = torch.from_numpy(at_working_width(rgb.astype(np.float32) / 255))
        with torch.inference_mode():
            logits = self(picture.permute(2, 0, 1)[None])[0]
            return np.asarray(logits.sigmoid().numpy(), dtype=np.float32)


def at_working_width(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an image (H, W, C) resized to 640 pixels from left to right."""
    height, width = image.shape[:2]
    size = (_WIDTH, max(1, round(_WIDTH * height / width)))
    how = cv2.INTER_AREA if width > _WIDTH else cv2.INTER_LINEAR
    return image if width == _WIDTH else cv2.resize(image, size, interpolation=how)
