"""One frame's points next to its surface image, and the pixels around points: what they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.camera import Camera
from pliant.spec.conventions import OUT_OF_FRAME
from pliant.spec.model import Tier
from pliant.spec.validation.rules.correspondences import FrameRows
from pliant.spec.validation.rules.points import PointSet
from pliant.spec.validation.rules.surfaces import ShownSurface

SLOPE = 3.0
"""Largest step between neighbouring pixels of a smooth place, in pixel footprints."""

THIN = 2.0
"""A tube or ball is judged if its diameter, and a sheet if the strip that its points cover, is at
least this wide, in pixels at its depth."""

ENOUGH: Final = 8
"""Points that tell how narrow an object is, or whether a frame is another's."""

NEARBY = 16
"""How far from a pixel of its object a part may reach that no pixel shows, in pixels; and so many
pixels tell that an object is not too thin to be seen."""

FINE: Final = 0.5
"""Second difference of the material, in pixel footprints: where it is larger, a cloth may have
wrinkles between pixel centres, which hide what is near. (It was at least 0.9 at all 300 points that
were wrongly doubted in cloths 20 px wide.)"""

_AROUND = np.arange(-2, 3)
_INNER = slice(1, 4)


@dataclass(frozen=True)
class SoundFrame:
    """The rows of a frame, its camera and its surface image, all of them sound.

    Attributes:
        tier: The sequence's tier.
        camera: The frame's camera.
        points: The sequence's points.
        rows: The frame's N rows.
        good: bool (N,), rows that project to where they say; rules leave out the others.
        surface: The frame's surface image.
    """

    tier: Tier
    camera: Camera
    points: PointSet
    rows: FrameRows
    good: npt.NDArray[np.bool_]
    surface: ShownSurface

    @property
    def focal_px(self) -> float:
        """The smaller focal length: depth over it is a pixel's footprint, metres."""
        K = self.camera.K
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
        """Return the diameters of objects, float64 as `object_id`; 0 for those without a tube."""
        found = np.zeros(object_id.shape)
        for each in self.tier.objects:
            found[object_id == each.id] = each.diameter_m
        return found

    @cached_property
    def narrow(self) -> list[int]:
        """Objects whose points in the image project to a strip that pixel centres may miss."""
        inside = np.flatnonzero(self.good & (self.rows.state != OUT_OF_FRAME))
        own = self.own(inside)
        counts = np.bincount(own)
        strips = edge_on(own, self.rows.uv_px[inside])
        return [each for each in strips if counts[each] >= ENOUGH]

    @cached_property
    def unknown(self) -> list[int]:
        """Objects without points, which may be cables of any width."""
        return sorted({each.id for each in self.tier.objects} - set(self.points.object_id.tolist()))

    @cached_property
    def barely_seen(self) -> list[int]:
        """Objects without points of which this frame shows a few pixels or none."""
        shown = self.surface.image.object_id
        return [each for each in self.unknown if np.count_nonzero(shown == each) < NEARBY]

    def steps_m(self, chosen: npt.NDArray[np.int64], index: npt.NDArray[np.int64]) -> FloatArray:
        """Return how far the material of some pixels is from that of some points.

        Args:
            chosen: int64 (n,), rows.
            index: int64 (n, H, W), flat indices of H x W pixels.

        Returns:
            float64 (n, H, W, 2), metres along each coordinate; infinite where a pixel shows
            another object than the point's.
        """
        image = self.surface.image
        point = np.broadcast_to(self.rows.point[chosen, None, None], index.shape)
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


@dataclass(frozen=True)
class Windows:
    """The 5x5 pixels around N points that are far enough from the border.

    Attributes:
        view: The frame.
        chosen: int64 (N,), rows.
        pixel: int64 (N, 2), the pixels (u, v) that contain the points.
        object_id: uint32 (N, 5, 5).
        depth_m: float32 (N, 5, 5).
        steps_m: float64 (N, 3, 3, 2), on the material from the point to the surface of the inner
            pixels; infinite where that is another object.
        footprint_m: float64 (N,), a pixel's width at the point's depth.
        uniform: bool (N,), one object id.
        smooth: bool (N,), also without steps of depth or material.
    """

    view: SoundFrame
    chosen: npt.NDArray[np.int64]
    pixel: npt.NDArray[np.int64]
    object_id: npt.NDArray[np.uint32]
    depth_m: npt.NDArray[np.float32]
    steps_m: FloatArray
    footprint_m: FloatArray
    uniform: npt.NDArray[np.bool_]
    smooth: npt.NDArray[np.bool_]

    @classmethod
    def around(
        cls, view: SoundFrame, chosen: npt.NDArray[np.int64], pixel: npt.NDArray[np.int64]
    ) -> Windows:
        """Gather the pixels around the points of some rows."""
        image = view.surface.image
        width = view.size[0]
        around = (_AROUND[:, None] * width + _AROUND[None, :])[None]
        index = (pixel[:, 1] * width + pixel[:, 0])[:, None, None] + around
        object_id = image.object_id.ravel().take(index)
        depth = image.depth_m.ravel().take(index)
        uniform = np.all(object_id == object_id[:, 2:3, 2:3], axis=(1, 2))
        smooth = uniform.copy()
        for each in view.tier.objects:
            mine = np.flatnonzero(uniform & (object_id[:, 2, 2] == each.id))
            if mine.size:
                # The footprint is that of the surface shown, which may not be the point's.
                z = depth[mine]
                step = SLOPE * (z[:, 2, 2] / view.focal_px)[:, None, None]
                m = np.stack([c.ravel().take(index[mine]) for c in (image.m0, image.m1)], -1)
                rough = np.zeros(mine.size, np.bool_)
                for axis in (1, 2):
                    rough |= np.any(np.abs(np.diff(z, axis=axis)) > step, axis=(1, 2))
                    jump = (each.steps_m(np.diff(m, axis=axis)) ** 2).sum(axis=-1)
                    rough |= np.any(jump > step * step, axis=(1, 2))
                smooth[mine] = ~rough
        return cls(
            view,
            chosen,
            pixel,
            object_id,
            depth,
            view.steps_m(chosen, index[:, _INNER, _INNER]),
            view.rows.depth_m[chosen] / view.focal_px,
            uniform,
            smooth,
        )

    @property
    def near_m(self) -> npt.NDArray[np.float32]:
        """Depth of the inner pixels, float32 (N, 3, 3)."""
        return self.depth_m[:, _INNER, _INNER]

    @property
    def near_id(self) -> npt.NDArray[np.uint32]:
        """Object ids of the inner pixels, uint32 (N, 3, 3)."""
        return self.object_id[:, _INNER, _INNER]

    @property
    def point_depth_m(self) -> FloatArray:
        """The points' own depths, float64 (N,)."""
        return self.view.rows.depth_m[self.chosen]

    @cached_property
    def own(self) -> npt.NDArray[np.int32]:
        """The points' objects, int32 (N,)."""
        return self.view.own(self.chosen)

    def behind(self, which: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Return which of some points are not in front of the object that their pixels show."""
        behind = which & self.uniform & (self.object_id[:, 2, 2] != 0)
        rows = np.flatnonzero(behind)
        inside = self.view.rows.uv_px[self.chosen[rows]] - self.pixel[rows]
        behind[rows] = _is_behind(
            self.depth_m[rows], inside, self.point_depth_m[rows], self.smooth[rows]
        )
        return behind

    def resolved(self, which: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Return around which smooth points the material shown bends by `FINE` footprints at most.

        Where it bends more, a cloth has wrinkles that are narrower than its pixels.

        Args:
            which: bool (N,), the points to look at; False for all others.
        """
        found = np.zeros(len(self.own), np.bool_)
        image = self.view.surface.image
        for index in np.flatnonzero(which):
            u, v = self.pixel[index]
            around = np.s_[v - 2 : v + 3, u - 2 : u + 3]
            m = np.stack([image.m0[around], image.m1[around]], axis=-1)
            steps_m = self.view.tier.object(int(self.own[index])).steps_m
            steps = [steps_m(np.diff(m, axis=axis)) for axis in (0, 1)]
            bends = [np.diff(step, axis=axis) for axis, step in enumerate(steps)]
            most = max(float((bend**2).sum(axis=-1).max()) for bend in bends)
            found[index] = most <= (FINE * self.footprint_m[index]) ** 2
        return found

    def thin(self, own: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        """Return at which points an object `own`, int32 (N,), may be missed by pixel centres.

        It is thinner than `THIN` footprints, or of unknown shape and barely seen.
        """
        thin = is_thin(self.view.diameter_m(own), self.footprint_m)
        return thin | np.isin(own, [*self.view.narrow, *self.view.barely_seen])

    def seen_nearby(self, which: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Return which points have a pixel of their own object within `NEARBY` pixels.

        Args:
            which: bool (N,), the points to look at; False for all others.
        """
        found = np.zeros(len(self.own), np.bool_)
        for index in np.flatnonzero(which):
            found[index] = np.any(self._around(index) == self.own[index])
        return found

    def others_nearby(
        self, which: npt.NDArray[np.bool_], others: Sequence[int]
    ) -> npt.NDArray[np.bool_]:
        """Return which points have other objects within `NEARBY` pixels, or that pixels may miss.

        Args:
            which: bool (N,), the points to look at; False for all others.
            others: The objects to look for, apart from the point's own.
        """
        found = np.zeros(len(self.own), np.bool_)
        if not which.any():
            return found
        for each in others:
            name = np.full(len(self.own), each, np.int32)
            found |= which & (self.own != each) & self.thin(name)
        for index in np.flatnonzero(which & ~found):
            around = self._around(index)
            found[index] = np.any(np.isin(around, others) & (around != self.own[index]))
        return found

    def _around(self, index: np.intp) -> npt.NDArray[np.uint32]:
        """Return the object ids up to `NEARBY` pixels from a point."""
        u, v = self.pixel[index]
        return self.view.surface.image.object_id[
            max(v - NEARBY, 0) : v + NEARBY + 1, max(u - NEARBY, 0) : u + NEARBY + 1
        ]


def is_thin(diameter_m: FloatArray, footprint_m: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which tubes, of diameter 0 for anything else, are too thin to be judged."""
    thin: npt.NDArray[np.bool_] = (diameter_m > 0) & (diameter_m < THIN * footprint_m)
    return thin


def edge_on(own: npt.NDArray[np.int32], uv_px: FloatArray) -> list[int]:
    """Return the objects whose points all project to a strip narrower than `THIN` pixels.

    Args:
        own: int32 (N,), the objects of points.
        uv_px: float64 (N, 2).
    """
    found = []
    for object_id in np.unique(own):
        uv = uv_px[own == object_id]
        # The width of an even strip is the square root of 12 times its variance.
        variance = np.linalg.eigvalsh(np.cov(uv.T, bias=True))[0]
        if 12 * variance < THIN**2:
            found.append(int(object_id))
    return found


def _is_behind(
    z: npt.NDArray[np.float32],
    inside: FloatArray,
    depth: FloatArray,
    smooth: npt.NDArray[np.bool_],
) -> npt.NDArray[np.bool_]:
    """Return which points are not in front of the surface that their 5x5 pixels show.

    At a smooth place the surface is interpolated between the four pixel centres around the
    point; the largest second difference of the 5x5 bounds the error. Elsewhere a point is
    behind if it is behind all of its 3x3.

    Args:
        z: float32 (N, 5, 5), metres.
        inside: float64 (N, 2), place of the point in its pixel, 0 to 1.
        depth: float64 (N,), the points' depth, metres.
        smooth: bool (N,).
    """
    with np.errstate(invalid="ignore"):
        bends = [np.abs(np.diff(z, 2, axis=axis)).max(axis=(1, 2)) for axis in (1, 2)]
        error = np.maximum(*bends) + 1e-6 * depth
        rows = np.arange(len(z))
        low = 2 + np.floor(inside - 0.5).astype(np.int64)
        a, b = (inside - 0.5 - np.floor(inside - 0.5)).T
        u, v = low.T
        upper = (1 - a) * z[rows, v, u] + a * z[rows, v, u + 1]
        lower = (1 - a) * z[rows, v + 1, u] + a * z[rows, v + 1, u + 1]
        limit = np.where(
            smooth, (1 - b) * upper + b * lower - error, z[:, _INNER, _INNER].max(axis=(1, 2))
        )
        behind: npt.NDArray[np.bool_] = depth >= limit
    return behind
