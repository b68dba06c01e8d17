"""How the points of the tables fit the surface images, to a fraction of a pixel.

Around a visible point the surface image is nearly affine: m(u, v) = m0 + J (u, v). The point's own
material coordinate minus the image's at (u_px, v_px), multiplied by the inverse of J, is how far
the table and the image are apart, in pixels. One point proves little; the median over the points
of a sequence finds a constant shift to a hundredth of a pixel. The same four pixels give the depth
that the image shows at the point, and how many metres one unit of the material is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.io.exr import Surface
from pliant.spec.validation.rules.cameras import Cameras
from pliant.spec.validation.rules.correspondences import VISIBLE, FrameRows
from pliant.spec.validation.rules.points import PointSet

SAMPLES_PER_FRAME = 96
SAMPLES_PER_SEQUENCE = 1536
"""So many visible points are measured; a median needs no more."""

MIN_SLOPE = 0.02
"""Smallest sine of the angle between the two material directions in the image."""

FloatArray = npt.NDArray[np.float64]

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


def measure(
    tier: dict[str, Any],
    cameras: Cameras,
    points: PointSet,
    rows: FrameRows,
    good: npt.NDArray[np.bool_],
    surface: Surface,
) -> Measured | None:
    """Measure some visible surface points of a frame.

    Args:
        tier: The sequence's tier.
        cameras: The sequence's cameras.
        points: The sequence's points.
        rows: The frame's rows.
        good: bool (N,), rows that project to where they say.
        surface: The frame's surface image, valid.

    Returns:
        The measurements, None if no point has 4x4 pixels of its own object around it.
    """
    width = surface.depth_m.shape[1]
    cell = np.floor(np.clip(rows.uv_px - 0.5, -8.0, 2.0**20)).astype(np.int64)
    last = np.array([width, surface.depth_m.shape[0]]) - 2
    inner = np.all((cell >= 1) & (cell < last), axis=1)
    seen = good & inner & (rows.state == VISIBLE) & ~points.centreline[rows.point]
    chosen = np.flatnonzero(seen)
    if chosen.size > SAMPLES_PER_FRAME:
        chosen = chosen[np.linspace(0, chosen.size - 1, SAMPLES_PER_FRAME).astype(np.int64)]
    own = points.object_id[rows.point[chosen]]
    around = (_AROUND[:, None] * width + _AROUND[None, :]).ravel()
    index = (cell[chosen, 1] * width + cell[chosen, 0])[:, None] + around
    same = np.all(surface.object_id.ravel().take(index) == own[:, None], axis=1)
    chosen, own, index = chosen[same], own[same], index[same]
    if not chosen.size:
        return None
    m = _material(tier, points, rows.point[chosen], own, surface, index)
    depth = surface.depth_m.ravel().take(index).reshape(-1, 4, 4).astype(np.float64)
    uv = rows.uv_px[chosen]
    a, b = (uv - 0.5 - cell[chosen]).T
    du, dv = _along_u(m, b), _along_v(m, a)
    here = _bilinear(m, a, b)
    determinant = du[0] * dv[1] - du[1] * dv[0]
    size = np.hypot(du[0], dv[0]) * np.hypot(du[1], dv[1])
    bend = np.maximum(
        np.abs(np.diff(m, 2, axis=3)).max(axis=(2, 3)), np.abs(np.diff(m, 2, axis=2)).max((2, 3))
    )
    K = cameras.K[rows.frame]
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
    metres[own != tier["queried_object"]] = np.nan
    keep = (np.abs(determinant) > MIN_SLOPE * size) & np.isfinite(error)
    return Measured(
        frame=np.full(int(np.count_nonzero(keep)), rows.frame),
        offset_px=offset[keep],
        error_px=error[keep],
        depth_m=rows.depth_m[chosen][keep],
        # 1 / z, not z, is affine in the image of a plane.
        shown_m=1 / _bilinear(1 / depth[None], a, b)[0][keep],
        ray=np.sqrt(1 + (slope**2).sum(axis=1))[keep],
        footprint_m=(rows.depth_m[chosen] / min(K[0, 0], K[1, 1]))[keep],
        metres=metres[keep],
    )


def _material(
    tier: dict[str, Any],
    points: PointSet,
    point: npt.NDArray[np.int32],
    own: npt.NDArray[np.int32],
    surface: Surface,
    index: npt.NDArray[np.int64],
) -> FloatArray:
    """Return the image's material minus the points' own, (2, N, 4, 4), without a seam."""
    m = np.empty((2, len(point), 4, 4))
    for axis, channel in enumerate((surface.m0, surface.m1)):
        m[axis] = channel.ravel().take(index).reshape(-1, 4, 4)
        m[axis] -= points.material[point, axis][:, None, None]
        for thing in tier["objects"]:
            period = thing["material"][axis]["period"]
            if period is not None:
                mine = own == thing["id"]
                m[axis, mine] -= period * np.round(m[axis, mine] / period)
    return m


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
