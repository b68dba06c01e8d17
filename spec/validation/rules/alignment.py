"""How the points of the tables fit the surface images, to a fraction of a pixel.

Around a visible point the surface image is nearly affine: m(u, v) = m0 + J (u, v). The point's own
material coordinate minus the image's at (u_px, v_px), multiplied by the inverse of J, is how far
the table and the image are apart, in pixels. One point proves little; the median over the points
of a sequence finds a constant shift to a hundredth of a pixel. The same four pixels give the depth
that the image shows at the point, and how many metres one unit of the material is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.conventions import VISIBLE
from pliant.spec.validation.rules.windows import SoundFrame

SAMPLES_PER_FRAME = 96
SAMPLES_PER_SEQUENCE = 1536
"""So many visible points are measured; a median needs no more."""

MIN_SLOPE = 0.02
"""Smallest sine of the angle between the two material directions in the image."""

JUMP: Final = 6.0
"""Largest step of the material between neighbours over the usual one, on one surface."""

_AROUND = np.arange(-1, 3)


@dataclass(frozen=True)
class Measured:
    """Measured visible points.

    Attributes:
        frame: int64 (N,).
        offset_px: float64 (N, 2), the image minus the table, pixels.
        error_px: float64 (N,), bound of the interpolation's error, pixels.
        depth_m: float64 (N,), of the table.
        shown_m: float64 (N,), depth of the image at the same place.
        ray: float64 (N,), length of the ray through the place over its planar depth, >= 1.
        footprint_m: float64 (N,), a pixel's width at the point's depth.
        bend_px: float64 (N,), interpolation error that the mean second differences explain, pixels.
        noise_px: float64 (N,), noise of the material from pixel to pixel, pixels.
        bend_depth: float64 (N,), as `bend_px` of the depth, footprints.
        noise_depth: float64 (N,), as `noise_px` of the depth, footprints.
        metres: float64 (N, 2), metres on the surface for one unit of each material coordinate;
            NaN for another object than the queried one.
    """

    frame: npt.NDArray[np.int64]
    offset_px: FloatArray
    error_px: FloatArray
    depth_m: FloatArray
    shown_m: FloatArray
    ray: FloatArray
    footprint_m: FloatArray
    bend_px: FloatArray
    noise_px: FloatArray
    bend_depth: FloatArray
    noise_depth: FloatArray
    metres: FloatArray

    def __len__(self) -> int:
        return len(self.frame)

    def chosen(self, keep: npt.NDArray[np.bool_]) -> Measured:
        """Return some of the points."""
        return Measured(**{name: values[keep] for name, values in vars(self).items()})


@dataclass(frozen=True)
class Sample:
    """Visible points with the 4x4 pixels around them, yet to be measured.

    Attributes:
        frame: int64 (N,).
        uv_px: float64 (N, 2), of the table.
        depth_m: float64 (N,), of the table.
        queried: bool (N,), True for points of the queried object.
        K: float64 (N, 3, 3), intrinsics of the frame.
        cell: int64 (N, 2), the pixel (u, v) whose centre is left of and above the point.
        material: float64 (N, 4, 4, 2), the image's material minus the point's own.
        shown_m: float32 (N, 4, 4), depth of the image.
    """

    frame: npt.NDArray[np.int64]
    uv_px: FloatArray
    depth_m: FloatArray
    queried: npt.NDArray[np.bool_]
    K: FloatArray
    cell: npt.NDArray[np.int64]
    material: FloatArray
    shown_m: npt.NDArray[np.float32]


@dataclass
class Alignment:
    """Sampled points of a sequence.

    Attributes:
        samples: Of each frame that has some.
    """

    samples: list[Sample] = field(default_factory=list)

    def add(self, view: SoundFrame) -> None:
        """Sample a frame, unless there are enough points already."""
        if sum(len(sample.frame) for sample in self.samples) < SAMPLES_PER_SEQUENCE:
            sample = _sample(view)
            if sample is not None:
                self.samples.append(sample)

    def frames(self) -> list[Measured]:
        """Measure the points, all at once; return them frame by frame."""
        if not self.samples:
            return []
        measured = _measure(Sample(**_concatenated(self.samples)))
        numbers = [sample.frame[0] for sample in self.samples]
        parts = [measured.chosen(measured.frame == number) for number in numbers]
        return [part for part in parts if len(part)]


def joined(parts: Sequence[Measured]) -> Measured | None:
    """Return the measured points of several frames as one, None without any."""
    return Measured(**_concatenated(parts)) if parts else None


def _concatenated(parts: Sequence[Any]) -> dict[str, npt.NDArray[Any]]:
    return {name: np.concatenate([getattr(p, name) for p in parts]) for name in vars(parts[0])}


def _sample(view: SoundFrame) -> Sample | None:
    """Return some visible surface points with 4x4 pixels of their own object, None without any."""
    rows, image = view.rows, view.surface.image
    width = view.size[0]
    cell = np.floor(rows.uv_px - 0.5)
    inner = np.all((cell >= 1) & (cell < np.array(view.size) - 2), axis=1)
    seen = view.good & inner & (rows.state == VISIBLE) & ~view.points.centreline[rows.point]
    chosen = np.flatnonzero(seen)
    if chosen.size > SAMPLES_PER_FRAME:
        chosen = chosen[np.linspace(0, chosen.size - 1, SAMPLES_PER_FRAME).astype(np.int64)]
    own = view.own(chosen)
    u, v = cell[chosen].astype(np.int64).T
    index = (v * width + u)[:, None, None] + (_AROUND[:, None] * width + _AROUND)
    same = np.all(image.object_id.ravel().take(index) == own[:, None, None], axis=(1, 2))
    chosen, own, index = chosen[same], own[same], index[same]
    if not chosen.size:
        return None
    m = np.stack([channel.ravel().take(index) for channel in (image.m0, image.m1)], axis=-1)
    gap = m.astype(np.float64) - view.points.material[rows.point[chosen]][:, None, None]
    for each in view.tier.objects:  # without a seam
        mine = own == each.id
        gap[mine] = each.wrapped(gap[mine])
    return Sample(
        frame=np.full(chosen.size, rows.frame),
        uv_px=rows.uv_px[chosen],
        depth_m=rows.depth_m[chosen],
        queried=own == view.tier.queried_object,
        K=np.broadcast_to(view.camera.K, (chosen.size, 3, 3)),
        cell=cell[chosen].astype(np.int64),
        material=gap,
        shown_m=image.depth_m.ravel().take(index),
    )


def _measure(sample: Sample) -> Measured:
    """Measure sampled points, except where the material has no two directions or has a jump."""
    m = np.moveaxis(sample.material, -1, 0)
    depth = sample.shown_m.astype(np.float64)
    a, b = (sample.uv_px - 0.5 - sample.cell).T
    focal, centre = sample.K[:, [0, 1], [0, 1]], sample.K[:, [0, 1], 2]
    du, dv = _along_u(m, b), _along_v(m, a)
    here = _bilinear(m, a, b)
    determinant = du[0] * dv[1] - du[1] * dv[0]
    size = np.hypot(du[0], dv[0]) * np.hypot(du[1], dv[1])
    bend = np.maximum(
        np.abs(np.diff(m, 2, axis=3)).max(axis=(2, 3)), np.abs(np.diff(m, 2, axis=2)).max((2, 3))
    )
    slope = (sample.uv_px - centre) / focal
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = np.stack(
            [dv[0] * here[1] - dv[1] * here[0], du[1] * here[0] - du[0] * here[1]], axis=1
        )
        offset /= determinant[:, None]
        across = np.abs(dv) + np.abs(du)
        error = (across[1] * bend[0] + across[0] * bend[1]) / (8 * np.abs(determinant))
        curve = _bend(m)
        bend_px = (across[1] * curve[0] + across[0] * curve[1]) / (8 * np.abs(determinant))
        noise = _noise(m)
        noise_px = np.maximum(
            np.hypot(dv[1] * noise[0], dv[0] * noise[1]),
            np.hypot(du[1] * noise[0], du[0] * noise[1]),
        ) / np.abs(determinant)
        # |dX / dm0| and |dX / dm1|: [Xu Xv] times the inverse of J.
        u = sample.cell[:, 0, None, None] + 0.5 + _AROUND[None, None, :]
        v = sample.cell[:, 1, None, None] + 0.5 + _AROUND[None, :, None]
        (cx, cy), (fx, fy) = centre.T[..., None, None], focal.T[..., None, None]
        position = np.stack([(u - cx) / fx * depth, (v - cy) / fy * depth, depth])
        xu, xv = _along_u(position, b), _along_v(position, a)
        sides = (xu * dv[1] - xv * du[1], xv * du[0] - xu * dv[0])
        metres = np.stack([np.linalg.norm(side / determinant, axis=0) for side in sides], axis=1)
    metres[~sample.queried] = np.nan
    footprint = sample.depth_m / focal.min(axis=1)
    found = Measured(
        frame=sample.frame,
        offset_px=offset,
        error_px=error,
        depth_m=sample.depth_m,
        # 1 / z, not z, is affine in the image of a plane.
        shown_m=1 / _bilinear(1 / depth[None], a, b)[0],
        ray=np.sqrt(1 + (slope**2).sum(axis=1)),
        footprint_m=footprint,
        bend_px=bend_px,
        noise_px=noise_px,
        bend_depth=_bend(depth[None])[0] / 8 / footprint,
        noise_depth=_noise(depth[None])[0] / footprint,
        metres=metres,
    )
    usable = (np.abs(determinant) > MIN_SLOPE * size) & np.isfinite(error)
    return found.chosen(usable & _is_one_surface(m))


def _is_one_surface(m: FloatArray) -> npt.NDArray[np.bool_]:
    """Return where material (2, N, 4, 4) has no jump: not two parts of an object that cross."""
    along_u, along_v = (np.abs(np.diff(m, axis=axis)) for axis in (3, 2))
    slope = np.median(along_u, axis=(2, 3)) + np.median(along_v, axis=(2, 3))
    largest = np.maximum(along_u.max(axis=(2, 3)), along_v.max(axis=(2, 3)))
    return np.asarray(np.all(largest <= JUMP * slope, axis=0))


def _bend(values: FloatArray) -> FloatArray:
    """Return |mean second difference| along u plus along v of (C, N, 4, 4): (C, N).

    A mean over the 4x4 pixels: noise cancels in it, curvature does not.
    """
    along_u, along_v = (np.diff(values, 2, axis=axis).mean(axis=(2, 3)) for axis in (3, 2))
    return np.asarray(np.abs(along_u) + np.abs(along_v))


def _noise(values: FloatArray) -> FloatArray:
    """Return the standard deviation of noise in (C, N, 4, 4) from its third differences: (C, N).

    A smooth surface has small ones. Those of white noise have 20 times its variance, and the
    median of their size is 0.6745 of their deviation.
    """
    along_u = np.diff(values, 3, axis=3)[..., 0]
    along_v = np.diff(values, 3, axis=2)[..., 0, :]
    size = np.median(np.abs(np.concatenate([along_u, along_v], axis=-1)), axis=-1)
    return np.asarray(size / (0.6745 * np.sqrt(20)))


def _bilinear(values: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Interpolate (C, N, 4, 4) in the middle cell at the fractions (a, b): (C, N)."""
    q = values[..., 1:3, 1:3]
    upper = q[..., 0, 0] * (1 - a) + q[..., 0, 1] * a
    lower = q[..., 1, 0] * (1 - a) + q[..., 1, 1] * a
    return np.asarray(upper * (1 - b) + lower * b)


def _along_u(values: FloatArray, b: FloatArray) -> FloatArray:
    q = np.diff(values[..., 1:3, 1:3], axis=-1)[..., 0]
    return np.asarray(q[..., 0] * (1 - b) + q[..., 1] * b)


def _along_v(values: FloatArray, a: FloatArray) -> FloatArray:
    q = np.diff(values[..., 1:3, 1:3], axis=-2)[..., 0, :]
    return np.asarray(q[..., 0] * (1 - a) + q[..., 1] * a)
