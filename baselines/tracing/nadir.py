"""Where a camera over a table looks straight down."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from pliant.baselines.tracing.depth_in_mask import FloatArray

FOCAL_WIDTHS: Final = 1.07
"""Assumed focal length in image widths: a horizontal field of view of 50 degrees."""


@dataclass(frozen=True)
class Nadir:
    """The place below a camera whose optical axis is the table's normal.

    Attributes:
        place_px: float64 (2,), where the axis meets the image; it may be outside.
        focal_px: Focal length, px.
        tilt: float64 (2,), what the axis is off the table's normal after all: the vector t of
            `tilt.py`.
    """

    place_px: FloatArray
    focal_px: float
    tilt: FloatArray = field(default_factory=lambda: np.zeros(2))

    @property
    def below_px(self) -> FloatArray:
        """The place below the camera with its tilt, float64 (2,)."""
        return self.place_px + self.focal_px * self.tilt

    @classmethod
    def of_image(cls, shape: tuple[int, ...]) -> Nadir:
        """Return that of an image taken from straight above, of shape (height, width, ...)."""
        height, width = shape[:2]
        return cls(np.array([width / 2, height / 2]), FOCAL_WIDTHS * width)

    def scaled(self, scale: float, shift_px: FloatArray | float = 0.0) -> Nadir:
        """Return that of the image magnified by `scale` and then moved by `shift_px`."""
        return Nadir(scale * self.place_px + shift_px, scale * self.focal_px, self.tilt)

    def magnification(self, places_px: FloatArray) -> FloatArray:
        """Return the table's scale at places (N, 2) over that at `place_px`, float64 (N,)."""
        aside = (places_px - self.place_px) / self.focal_px
        return np.asarray((1 + aside @ self.tilt).clip(0.5, 2.0))
