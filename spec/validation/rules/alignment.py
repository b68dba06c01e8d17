"""How the points of the tables fit the surface images, to a fraction of a pixel.

Around a visible point the surface image is nearly affine: m(u, v) = m0 + J (u, v). The point's own
material coordinate minus the image's at (u_px, v_px), multiplied by the inverse of J, is how far
the table and the image are apart, in pixels. One point proves little; the median over the points
of a sequence finds a constant shift to a hundredth of a pixel. The same four pixels give the depth
that the image shows at the point, and how many metres one unit of the material is.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pliant.spec.model import FloatArray
from pliant.spec.validation.rules.correspondences import VISIBLE
from pliant.spec.validation.rules.frames import FrameView

SAMPLES_PER_FRAME = 96
SAMPLES_PER_SEQUENCE = 1536
"""So many visible points are measured; a median needs no more."""

MIN_SLOPE = 0.02
"""Smallest sine of the angle between the two material directions in the image."""

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
    metres: FloatArray

    def __len__(self) -> int:
        return len(self.frame)


@dataclass
class Alignment:
    """The measured points of a sequence, frame by frame.

    Attributes:
        parts: Of each frame that has some.
    """

    parts: list[Measured] = field(default_factory=list)

    @property
    def full(self) -> bool:
        """True if further frames add nothing."""
        return sum(len(part) for part in self.parts) >= SAMPLES_PER_SEQUENCE

    def joined(self) -> Measured | None:
        """Return all measured points, None without any."""
        if not self.parts:
            return None
        names = Measured.__dataclass_fields__
        return Measured(
            **{name: np.concatenate([getattr(part, name) for part in self.parts]) for name in names}
        )


def measure(view: FrameView) -> Measured | None:
    """Measure some visible surface points of a frame.

    Args:
        view: The frame.

    Returns:
        The measurements, None if no point has 4x4 pixels of its own object around it.
    """
    rows, image, K = view.rows, view.surface.image, view.intrinsics
    width = view.size[0]
    cell = np.floor(np.clip(rows.uv_px - 0.5, -8.0, 2.0**20)).astype(np.int64)
    inner = np.all((cell >= 1) & (cell < np.array(view.size) - 2), axis=1)
    seen = view.good & inner & (rows.state == VISIBLE) & ~view.points.centreline[rows.point]
    chosen = np.flatnonzero(seen)
    if chosen.size > SAMPLES_PER_FRAME:
        chosen = chosen[np.linspace(0, chosen.size - 1, SAMPLES_PER_FRAME).astype(np.int64)]
    own = view.own(chosen)
    around = (_AROUND[:, None] * width + _AROUND[None, :]).ravel()
    index = (cell[chosen, 1] * width + cell[chosen, 0])[:, None] + around
    same = np.all(image.object_id.ravel().take(index) == own[:, None], axis=1)
    chosen, own, index = chosen[same], own[same], index[same]
    if not chosen.size:
        return None
    m = _material(view, chosen, own, index)
    depth = image.depth_m.ravel().take(index).reshape(-1, 4, 4).astype(np.float64)
    uv = rows.uv_px[chosen]
    a, b = (uv - 0.5 - cell[chosen]).T
    du, dv = _along_u(m, b), _along_v(m, a)
    here = _bilinear(m, a, b)
    determinant = du[0] * dv[1] - du[1] * dv[0]
    size = np.hypot(du[0], dv[0]) * np.hypot(du[1], dv[1])
    bend = np.maximum(
        np.abs(np.diff(m, 2, axis=3)).max(axis=(2, 3)), np.abs(np.diff(m, 2, axis=2)).max((2, 3))
    )
    slope = (uv - K[[0, 1], 2]) / K[[0, 1], [0, 1]]
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = np.stack(
            [dv[0] * here[1] - dv[1] * here[0], du[1] * here[0] - du[0] * here[1]], axis=1
        )
        offset /= determinant[:, None]
        reach = (np.abs(dv[1]) + np.abs(du[1])) * bend[0] + (np.abs(dv[0]) + np.abs(du[0])) * bend[
            1
        ]
        error = reach / (8 * np.abs(determinant))
        metres = _metres(cell[chosen], depth, a, b, du, dv, determinant, K)
    metres[own != view.tier.queried_object] = np.nan
    keep = (np.abs(determinant) > MIN_SLOPE * size) & np.isfinite(error)
    return Measured(
        frame=np.full(int(np.count_nonzero(keep)), rows.frame),
        offset_px=offset[keep],
        error_px=error[keep],
        depth_m=rows.depth_m[chosen][keep],
        # 1 / z, not z, is affine in the image of a plane.
        shown_m=1 / _bilinear(1 / depth[None], a, b)[0][keep],
        ray=np.sqrt(1 + (slope**2).sum(axis=1))[keep],
        footprint_m=(rows.depth_m[chosen] / view.focal_px)[keep],
        metres=metres[keep],
    )


def _material(
    view: FrameView,
    chosen: npt.NDArray[np.int64],
    own: npt.NDArray[np.int32],
    index: npt.NDArray[np.int64],
) -> FloatArray:
    """Return the image's material minus the points' own, (2, N, 4, 4), without a seam."""
    image = view.surface.image
    m = np.stack([channel.ravel().take(index) for channel in (image.m0, image.m1)], axis=-1)
    gap = m.astype(np.float64) - view.points.material[view.rows.point[chosen]][:, None]
    for each in view.tier.objects:
        mine = own == each.id
        gap[mine] = each.wrapped(gap[mine])
    return np.moveaxis(gap, -1, 0).reshape(2, -1, 4, 4)


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


def _metres(
    cell: npt.NDArray[np.int64],
    depth: FloatArray,
    a: FloatArray,
    b: FloatArray,
    du: FloatArray,
    dv: FloatArray,
    determinant: FloatArray,
    K: FloatArray,
) -> FloatArray:
    """Return |dX / dm0| and |dX / dm1|, (N, 2): [Xu Xv] times the inverse of J."""
    u = cell[:, 0, None, None] + 0.5 + _AROUND[None, None, :]
    v = cell[:, 1, None, None] + 0.5 + _AROUND[None, :, None]
    position = np.stack([(u - K[0, 2]) / K[0, 0] * depth, (v - K[1, 2]) / K[1, 1] * depth, depth])
    xu, xv = _along_u(position, b), _along_v(position, a)
    first = (xu * dv[1] - xv * du[1]) / determinant
    second = (xv * du[0] - xu * dv[0]) / determinant
    return np.stack([np.linalg.norm(first, axis=0), np.linalg.norm(second, axis=0)], axis=1)
