"""A small network that describes the print around each pixel of a cloth.

A descriptor network for blank cloths knows a point by where it is on the cloth. The print of a
cloth is known only from the two pictures of a pair: this network's descriptors agree where the
same part of a print is seen, whatever the print, at any angle.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import torch
from scipy.ndimage import binary_erosion
from torch import nn

from pliant.models.networks.unet import UNet
from pliant.spec.arrays import Float32Array, Mask, Rgb

PRINTS: Final = "prints.safetensors"
"""The weights of a run's `PrintNetwork`."""

_WIDTHS: Final = (16, 32, 64, 96)
_DIM: Final = 16
_LEAST_SPREAD: Final = 0.04

_LEAST_SHARE_SPREAD: Final = 0.03
"""Standard deviation of a colour's share of the brightness. Of the renders that this limit was
chosen on, blank cloths have up to 0.03 (95 %), printed ones from 0.02 to 0.12."""

_LEAST_PIXELS: Final = 50
_RIM_PX: Final = 2
_DARK: Final = 16.0  # of 255: shares of nearly black pixels say nothing


class PrintNetwork(UNet):
    """Descriptors, float (N, 16, h, w), of pictures as `print_planes` makes them, (N, 4, h, w).

    Attributes:
        log_scale: Logarithm of the inverse temperature of p = softmax(-scale * squared distance).
    """

    def __init__(self) -> None:
        super().__init__(4, _DIM, widths=_WIDTHS, global_blocks=1, patch=2)
        self.log_scale = nn.Parameter(torch.zeros(()))

    @property
    def scale(self) -> torch.Tensor:
        """Inverse temperature of p, a scalar."""
        return self.log_scale.exp()

    def described(self, rgb: Rgb, mask: Mask) -> torch.Tensor:
        """Return the descriptors of a picture.

        Args:
            rgb: uint8 (h, w, 3), sRGB.
            mask: bool (h, w), the cloth.

        Returns:
            float32 (16, h, w).
        """
        planes = print_planes(rgb.astype(np.float32) / 255, mask)
        with torch.inference_mode():
            described: torch.Tensor = self(torch.from_numpy(planes)[None])[0].float()
        return described


def print_planes(rgb: Float32Array, mask: Mask) -> Float32Array:
    """Return a cloth's colours less their mean, in units of their spread, and its mask.

    Args:
        rgb: float32 (h, w, 3), 0 to 1.
        mask: bool (h, w), the cloth.

    Returns:
        float32 (4, h, w), 0 outside of the mask.
    """
    inside = rgb[mask]
    if len(inside) == 0:
        return np.zeros((4, *mask.shape), dtype=np.float32)
    mean = inside.mean(axis=0)
    spread = float(np.sqrt(np.square(inside - mean).mean())) + _LEAST_SPREAD
    planes = np.concatenate([(rgb - mean) / spread, np.ones((*mask.shape, 1))], axis=2)
    return np.ascontiguousarray((planes * mask[..., None]).transpose(2, 0, 1), dtype=np.float32)


def is_printed(rgb: Rgb, mask: Mask) -> bool:
    """Return whether an object has several colours, more than light and folds can produce.

    Args:
        rgb: uint8 (h, w, 3), sRGB.
        mask: bool (h, w), the object.
    """
    inside = binary_erosion(mask, iterations=_RIM_PX)
    if inside.sum() < _LEAST_PIXELS:
        return False
    read = rgb[inside].astype(np.float64) + _DARK
    share = read / read.sum(axis=1, keepdims=True)
    return bool(share.std(axis=0).max() >= _LEAST_SHARE_SPREAD)
