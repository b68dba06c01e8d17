"""Colours relative to the table around an object, and pictures without the table's pattern.

r = I / I_table in linear light, where I_table is the mean of the table's pixels nearby. A shadow
darkens both alike, so log r is the same on either side of its edge.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from pliant.baselines.pixels import lies_on
from pliant.spec.arrays import BoolArray, FloatArray, Mask, Rgb

_TABLE_PX: Final = 12.0  # standard deviation of the Gaussian of `log_ratio_to_table`
_TABLE_SHARE: Final = 0.15  # that of `on_plain_table`, as a share of the picture's width
_LEAST_TABLE: Final = 1e-4  # weight of the whole table's mean
_DARK: Final = 0.002  # added to linear light, so that black has a logarithm
_LIGHT: Final = 0.5  # weight of the light of `VisibleTable`; the tint's is 1
_SPREADS: Final = 3.0
_LEAST, _MOST = 0.1, 0.4  # distance of colours of one table


def log_colour(rgb: Rgb) -> tuple[FloatArray, FloatArray]:
    """Return the logarithm of linear light, split into light and tint.

    Args:
        rgb: uint8 (H, W, 3), sRGB.

    Returns:
        The light: the mean over the channels, float64 (H, W). The tint: how much each channel
        differs from it, float64 (H, W, 3).
    """
    return _split(np.log(_linear(rgb)))


def log_ratio_to_table(rgb: Rgb, table: Mask) -> tuple[FloatArray, FloatArray]:
    """Return log r, split into light and tint.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
        table: bool (H, W), where the table is seen; not empty.

    Returns:
        The light: the mean of log r over the channels, float64 (H, W). The tint: how much log r
        of each channel differs from it, float64 (H, W, 3).
    """
    linear = _linear(rgb)
    return _split(np.log(linear / _nearby(linear, table, _TABLE_PX)))


def _linear(rgb: Rgb) -> FloatArray:
    """Return about the linear light of sRGB, never 0."""
    return np.asarray(((rgb / 255 + 0.055) / 1.055) ** 2.4 + _DARK)


def _split(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean over channels, (H, W), and what differs from it, (H, W, 3)."""
    light = values.mean(axis=-1)
    return light, values - light[..., None]


@dataclass(frozen=True)
class VisibleTable:
    """Where a picture shows the table, whose colour is that of most of the picture.

    Attributes:
        rgb: uint8 (H, W, 3), sRGB.
        objects: bool (H, W), what is known to be none of it.
    """

    rgb: Rgb
    objects: Mask

    def __call__(self, uv_px: FloatArray) -> BoolArray:
        """Return whether the table is seen at places (N, 2), bool (N,); outside it is not."""
        return lies_on(uv_px, self._seen)

    @functools.cached_property
    def _seen(self) -> Mask:
        light, tint = log_colour(self.rgb)
        look = np.dstack([tint, _LIGHT * light])
        away = ~self.objects & self.rgb.any(axis=2)  # pixels outside of a turned picture are black
        if not away.any():
            return away
        apart = np.linalg.norm(look - np.median(look[away], axis=0), axis=2)
        limit = float(np.clip(_SPREADS * np.median(apart[away]), _LEAST, _MOST))
        return np.asarray(away & (apart < limit))


def on_plain_table(rgb: Rgb, objects: Mask) -> Rgb:
    """Return a picture (H, W, 3) whose table is smoothed to its mean colour nearby.

    One pixel around the objects stays, which shows part of them.
    """
    table = cv2.erode((~objects).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    if not table.any() or not objects.any():
        return rgb
    mean = _nearby(rgb.astype(np.float32), table, _TABLE_SHARE * rgb.shape[1])
    return np.where(table[..., None], np.rint(mean), rgb).astype(np.uint8)


def _nearby(values: FloatArray, table: Mask, sigma_px: float) -> FloatArray:
    """Return the mean of the table's values around each pixel, weighted by a Gaussian.

    Far from the table, it is the mean of the whole table.
    """
    weight = table[..., None].astype(values.dtype)
    seen = weight * values
    far = _LEAST_TABLE * seen.sum(axis=(0, 1)) / weight.sum()
    share = cv2.GaussianBlur(weight, (0, 0), sigma_px)[..., None]
    return (cv2.GaussianBlur(seen, (0, 0), sigma_px) + far) / (share + _LEAST_TABLE)
