"""One frame's points next to its surface image: what the rules on both of them share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.model import Tier
from pliant.spec.validation.rules.cameras import Cameras
from pliant.spec.validation.rules.correspondences import FrameRows
from pliant.spec.validation.rules.points import PointSet
from pliant.spec.validation.rules.surfaces import ShownSurface


@dataclass(frozen=True)
class FrameView:
    """The rows of a frame, its camera and its surface image, all of them sound.

    Attributes:
        tier: The sequence's tier.
        cameras: The sequence's cameras.
        points: The sequence's points.
        rows: The frame's N rows.
        good: bool (N,), rows that project to where they say; rules leave out the others.
        surface: The frame's surface image.
    """

    tier: Tier
    cameras: Cameras
    points: PointSet
    rows: FrameRows
    good: npt.NDArray[np.bool_]
    surface: ShownSurface

    @property
    def intrinsics(self) -> FloatArray:
        """Intrinsics of the frame, float64 (3, 3), pixels."""
        return self.cameras.K[self.rows.frame]

    @property
    def focal_px(self) -> float:
        """The smaller focal length: depth over it is a pixel's footprint, metres."""
        K = self.intrinsics
        return float(min(K[0, 0], K[1, 1]))

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the image."""
        height, width = self.surface.mask.shape
        return width, height

    def own(self, chosen: npt.NDArray[np.int64]) -> npt.NDArray[np.int32]:
        """Return the objects of some rows' points, int32 (n,)."""
        return self.points.object_id[self.rows.point[chosen]]

    def diameter_m(self, object_id: npt.NDArray[np.int32]) -> FloatArray:
        """Return the diameters of objects, float64 (n,); 0 for those that are not tubes."""
        found = np.zeros(len(object_id))
        for each in self.tier.objects:
            found[object_id == each.id] = each.diameter_m
        return found

    def steps_m(self, chosen: npt.NDArray[np.int64], index: npt.NDArray[np.int64]) -> FloatArray:
        """Return how far the material of some pixels is from that of some points.

        Args:
            chosen: int64 (n,), rows.
            index: int64 (n, ...), flat indices of pixels.

        Returns:
            float64 (n, ..., 2), metres along each coordinate; infinite where a pixel shows
            another object than the point's.
        """
        image = self.surface.image
        point = np.broadcast_to(
            self.rows.point[chosen].reshape(-1, *(1,) * (index.ndim - 1)), index.shape
        )
        shown = image.object_id.ravel().take(index)
        same = shown == self.points.object_id[point]
        found = np.full((*index.shape, 2), np.inf)
        for each in self.tier.objects:
            place = np.nonzero(same & (shown == each.id))
            if place[0].size:
                seen = [channel.ravel().take(index[place]) for channel in (image.m0, image.m1)]
                gap = np.stack(seen, axis=-1) - self.points.material[point[place]]
                found[place] = np.abs(each.steps_m(gap))
        return found
