"""The shape of a mask: how deep and how far along it a place is, and whether it is of one rope."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import fft, ndimage, sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray, IntArray, Mask
from pliant.spec.ball import separate_ball, without_small_holes
from pliant.spec.frame import Frame
from pliant.spec.mask_box import mask_box

MARGIN: Final = 1.15
"""`half_width_px` over the median depth in a mask."""


def working_factor(mask: Mask) -> int:
    """Return how many pixels of a mask, along each side, become one pixel to read it.

    Strands stay wide enough to be distinguished.
    """
    factor = max(1, round(mask.shape[1] / TRACING.working_width_px))
    if factor == 1 or not mask.any():
        return 1
    half_px = float(np.percentile(depth_in_mask(mask, max(mask.shape))[mask], 90))
    return max(1, min(factor, int(half_px / TRACING.working_half_px)))


def shrunk(mask: Mask, factor: int) -> Mask:
    """Return a mask with a pixel for each block of pixels that is at least half covered.

    Args:
        mask: bool (H, W).
        factor: Side of a block, px; what is left over at the last row and column is dropped.
    """
    height, width = mask.shape[0] // factor, mask.shape[1] // factor
    whole = mask[: height * factor, : width * factor]
    blocks = whole.reshape(height, factor, width, factor).mean(axis=(1, 3))
    return np.asarray(blocks >= 0.5)


def depth_in_mask(mask: Mask, reach_px: int = 16) -> FloatArray:
    """Return each pixel's distance to the nearest pixel off the mask, px.

    Exact Euclidean distances.

    Args:
        mask: bool (H, W).
        reach_px: Larger distances are cut to this.

    Returns:
        float64 (H, W); 0 off the mask.
    """
    if mask.all():  # no pixel to be far from
        return np.full(mask.shape, float(reach_px))
    depth_px = np.zeros(mask.shape)
    box = mask_box(mask, 1)  # the nearest pixel off the mask is never farther away
    depth_px[box] = np.minimum(ndimage.distance_transform_edt(mask[box]), reach_px)
    return depth_px


def half_width_px(depth_px: FloatArray) -> float:
    """Return about half of a rope's width, px.

    Args:
        depth_px: float64, depths in its mask, from `depth_in_mask`.
    """
    inner = depth_px[depth_px > 1]
    return MARGIN * float(np.median(inner)) if len(inner) else 1.0


def ridge(depth_px: FloatArray, least_px: float) -> Mask:
    """Return the pixels that are as deep as any of the 5x5 around them: the middle of a strand.

    Args:
        depth_px: float64 (H, W), from `depth_in_mask`.
        least_px: They are deeper than this.

    Returns:
        bool (H, W).
    """
    return np.asarray((depth_px >= ndimage.maximum_filter(depth_px, 5)) & (depth_px > least_px))


def pixel_links(places: FloatArray | IntArray) -> sparse.csr_array:
    """Return which of N pixels are neighbours (of eight), (N, N); each pair stands once.

    Args:
        places: (N, 2), pixels.
    """
    count = len(places)
    pairs = np.zeros((0, 2), np.int64)
    if count:
        pairs = cKDTree(places).query_pairs(1.5, output_type="ndarray")
    return sparse.csr_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count))


def steps_along(mask: Mask, links: sparse.csr_array, start: tuple[int, int]) -> IntArray:
    """Return how many steps inside the mask (eight neighbours) lead from a pixel to each other one.

    Args:
        mask: bool (H, W).
        links: `pixel_links` of its pixels in row-major order.
        start: Row and column of a pixel of the mask.

    Returns:
        int64 (H, W); -1 where no way leads.
    """
    first = int(mask.ravel()[: start[0] * mask.shape[1] + start[1]].sum())
    found = csgraph.dijkstra(links, directed=False, indices=first, unweighted=True)
    steps = np.full(mask.shape, -1, dtype=np.int64)
    steps[mask] = np.where(np.isfinite(found), found, -1)
    return steps


def farthest_pixels(mask: Mask) -> list[tuple[int, int]]:
    """Return the two pixels, (row, column), that are farthest from each other along the mask.

    Args:
        mask: bool (H, W), not empty; of several parts only the first one is looked at.
    """
    box = mask_box(mask)
    mask = mask[box]
    places = np.argwhere(mask)
    links = pixel_links(places)
    row, column = places[0]
    ends = [(int(row), int(column))]
    for _ in range(3):  # the first sweep only finds an end to sweep from
        steps = steps_along(mask, links, ends[-1])
        row, column = np.unravel_index(int(steps.argmax()), mask.shape)
        ends.append((int(row), int(column)))
    return [(row + box[0].start, column + box[1].start) for row, column in ends[2:]]


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
    around = TRACING.shape_around
    return 2 * half_px**2 * float(np.sqrt(around**2 - 1) + around**2 * np.arcsin(1 / around))
