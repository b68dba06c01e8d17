"""Statistics of the shape of a mask that show whether it is that of one rope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from pliant.baselines.tracing.depth_in_mask import depth_in_mask, ridge, shrunk, working_factor
from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray, Mask
from pliant.spec.ball import separate_ball, without_small_holes
from pliant.spec.frame import Frame


@dataclass(frozen=True)
class MaskShape:
    """The shape of a mask.

    Attributes:
        parts: Its connected parts, together with the rope's ball; specks do not count.
        ends: Its loose ends: 2 of a rope, 1 of one with a ball, fewer where a knot hides them.
        has_ball: Whether the mask of the rope contains a ball.
    """

    parts: int
    ends: int
    has_ball: bool

    @classmethod
    def of(cls, mask: Mask, objects: Mask | None = None) -> MaskShape:
        """Return the shape of a mask.

        Args:
            mask: bool (H, W), the rope.
            objects: bool (H, W), the rope and its ball, or None.
        """
        factor = working_factor(mask)
        small = shrunk(mask, factor)
        whole = without_small_holes(small if objects is None else small | shrunk(objects, factor))
        labels, _ = ndimage.label(whole, np.ones((3, 3)))
        sizes = np.bincount(labels.ravel())[1:]
        parts = int((sizes >= TRACING.shape_least_part * sizes.max()).sum()) if len(sizes) else 0
        return cls(parts, _ends(whole), separate_ball(mask)[1] is not None)

    @property
    def several_ropes(self) -> bool:
        """Whether it shows more than one rope."""
        return self.parts > 1 or self.ends > 2

    def remark(self, name: str) -> str:
        """Return what a user should know, as a sentence; empty for a mask of one rope.

        Args:
            name: What the picture is called.
        """
        if self.several_ropes:
            return (
                f"The mask of the {name} shows more than one rope (parts: {self.parts}, loose "
                f"ends: {self.ends}), or one that is covered in places: give a mask of one rope."
            )
        if self.has_ball:
            return f"The mask of the {name} contains a ball, which was taken for rope."
        return ""


def has_ball(view: Frame) -> bool | None:
    """Return whether a rope has a ball, or None where its masks do not tell."""
    if view.mask is None or view.objects is None:
        return None
    return bool((view.objects & ~view.mask).any())


def _ends(mask: Mask) -> int:
    """Return how many loose ends a mask has: places with little of it around them."""
    depth_px = depth_in_mask(mask, max(mask.shape))
    middle = ridge(depth_px, 0.5)
    if not middle.any():
        return 0
    half_px = float(np.median(depth_px[middle]))
    reach = int(np.ceil(TRACING.shape_around * half_px))
    if reach > min(mask.shape):  # no rope: it fills the image
        return 0
    row, column = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = np.hypot(row, column) <= TRACING.shape_around * half_px
    around = _sum_around(mask, disc, reach)
    places, _ = ndimage.label(
        mask & (around < TRACING.shape_at_end * _strand_px2(half_px)), np.ones((3, 3))
    )
    return int((np.bincount(places.ravel())[1:] >= TRACING.shape_least_end * half_px**2).sum())


def _sum_around(mask: Mask, disc: Mask, reach: int) -> FloatArray:
    """Return how many pixels of a mask are in a disc of 2 reach + 1 pixels about each pixel.

    It is SciPy's `fftconvolve`, whose module takes half a second to import.
    """
    height, width = mask.shape
    fast = [fft.next_fast_len(side + 2 * reach, real=True) for side in mask.shape]
    product = fft.rfft2(mask.astype(np.float64), fast) * fft.rfft2(disc.astype(np.float64), fast)
    around: FloatArray = fft.irfft2(product, fast)
    return around[reach : reach + height, reach : reach + width]


def _strand_px2(half_px: float) -> float:
    """Return the area of a straight strand within the disc."""
    return (
        2
        * half_px**2
        * float(
            np.sqrt(TRACING.shape_around**2 - 1)
            + TRACING.shape_around**2 * np.arcsin(1 / TRACING.shape_around)
        )
    )
