"""An exact rasteriser: which triangle is under a pixel's centre, where in it, and how deep.

A pixel's centre is a ray d = ((u - cx) / fx, (v - cy) / fy, 1) from the camera. A triangle
with camera-space corners a, b, c is hit where z d = w0 a + w1 b + w2 c, sum w = 1, w >= 0. With
the edge planes n0 = b x c, n1 = c x a, n2 = a x b and det = a . n0 that gives

    w_i = (n_i . d) / sum_j (n_j . d),    z = det / sum_j (n_j . d)

(homogeneous rasterisation, Olano and Greer 1997). Nothing is divided by a corner's depth, so a
triangle that passes the camera's plane needs no clipping, and the barycentrics are those of
the surface in space, hence perspective-correct.

Two triangles that share an edge compute the same n with opposite signs, bit for bit, so a ray
falls on one side of it for both. A ray exactly in the edge's plane is decided as if d were moved by
(e, e^2, 0) with e infinitely small: exactly one of the two gets it. A closed surface has thus
neither cracks nor pixels hit twice. Of two triangles at equal depth the first one is kept.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from pliant.generator.compiled import compiled, inlined
from pliant.generator.scene.camera import NEAR_M
from pliant.spec.arrays import FloatArray, Int32Array, IntArray
from pliant.spec.camera import Camera

_LOW_PX: Final = -9.0
_HIGH_PX: Final = 1e6
# Limits of a triangle's box, outside any image.


class Hits(NamedTuple):
    """What each pixel's centre sees.

    Attributes:
        triangle: int32 (H, W), row of the faces, -1 where nothing is seen.
        depth_m: float64 (H, W), planar z, +inf where nothing is seen.
        weights: float64 (H, W, 2), barycentrics of the triangle's second and third corner.
    """

    triangle: Int32Array
    depth_m: FloatArray
    weights: FloatArray

    @classmethod
    def empty(cls, height: int, width: int) -> Hits:
        """Return the hits of an image in which nothing is seen."""
        triangle = np.full((height, width), -1, np.int32)
        return cls(triangle, np.full((height, width), np.inf), np.zeros((height, width, 2)))


class Lens(NamedTuple):
    """Focal lengths and principal point, px."""

    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def of(cls, camera: Camera, scale: int = 1) -> Lens:
        """Return the lens of a camera whose image has `scale` samples a side of a pixel."""
        K = camera.K * scale
        return cls(K[0, 0], K[1, 1], K[0, 2], K[1, 2])


def rasterise(camera: Camera, points_camera: FloatArray, faces: Int32Array, scale: int = 1) -> Hits:
    """Find the nearest triangle at the centre of every pixel.

    Args:
        camera: Intrinsics and image size.
        points_camera: float64 (V, 3), vertices in the camera's axes, metres.
        faces: int32 (F, 3).
        scale: Samples a side of a pixel; 2 gives an image of twice the width and height.

    Returns:
        The hits; arrays of (height * scale, width * scale).
    """
    hits = Hits.empty(camera.height * scale, camera.width * scale)
    uv_px = camera.to_pixels(points_camera)[:, :2] * scale
    points = np.ascontiguousarray(points_camera)
    rasterise_into(points, uv_px, faces, Lens.of(camera, scale), hits)
    return hits


@compiled
def box_in_image(
    points: FloatArray, uv: FloatArray, corners: tuple[int, int, int]
) -> tuple[float, float, float, float]:
    """Return the box of the image outside which a triangle is not seen.

    It is that of its corners, widened by far more than the projection's rounding. A triangle
    that passes the camera's plane can be anywhere; one behind it is nowhere.

    Args:
        points: float64 (V, 3), camera axes, metres.
        uv: float64 (V, 2), their projections, px.
        corners: The triangle's vertices.

    Returns:
        Lowest and highest u, lowest and highest v, px.
    """
    a, b, c = corners
    in_front = (points[a, 2] >= NEAR_M) + (points[b, 2] >= NEAR_M) + (points[c, 2] >= NEAR_M)
    if in_front == 0:
        return _LOW_PX, _LOW_PX, _LOW_PX, _LOW_PX
    if in_front < 3:
        return _LOW_PX, _HIGH_PX, _LOW_PX, _HIGH_PX
    return (
        min(uv[a, 0], uv[b, 0], uv[c, 0]) - 1e-6,
        max(uv[a, 0], uv[b, 0], uv[c, 0]) + 1e-6,
        min(uv[a, 1], uv[b, 1], uv[c, 1]) - 1e-6,
        max(uv[a, 1], uv[b, 1], uv[c, 1]) + 1e-6,
    )


@compiled
def covered_cells(
    low_px: float, high_px: float, cell_px: float, reach: float, count: int
) -> tuple[int, int]:
    """Return the first and last column (or row) of cells that a box can touch.

    Args:
        low_px: Where the box begins.
        high_px: Where it ends.
        cell_px: Side of a cell.
        reach: 0.5 asks for cells whose centre is in the box, 1 for cells that overlap it.
        count: Columns (rows) of the image.

    Returns:
        The last is below the first where there is none.
    """
    first = int(np.ceil(max(low_px, _LOW_PX) / cell_px - reach))
    last = int(np.floor(min(high_px, _HIGH_PX) / cell_px - (1.0 - reach)))
    return max(0, first), min(count - 1, last)


@compiled
def edge_planes(
    points: FloatArray, corners: tuple[int, int, int]
) -> tuple[float, float, float, float, float, float, float, float, float, float]:
    """Return the normals n0, n1 and n2 of a triangle's edge planes, and det = a . n0."""
    a, b, c = corners
    ax, ay, az = points[a, 0], points[a, 1], points[a, 2]
    bx, by, bz = points[b, 0], points[b, 1], points[b, 2]
    cx, cy, cz = points[c, 0], points[c, 1], points[c, 2]
    n0x, n0y, n0z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    n1x, n1y, n1z = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    n2x, n2y, n2z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    det = ax * n0x + ay * n0y + az * n0z
    return n0x, n0y, n0z, n1x, n1y, n1z, n2x, n2y, n2z, det


@compiled
def rasterise_into(
    points: FloatArray, uv: FloatArray, faces: Int32Array, lens: Lens, hits: Hits
) -> None:
    """Rasterise into hits that are empty, at least where a triangle can be seen.

    Args:
        points: float64 (V, 3), camera axes, metres.
        uv: float64 (V, 2), their projections, px.
        faces: int32 (F, 3).
        lens: Of the image of `hits`.
        hits: Written.
    """
    # Each look into a tuple of arrays inside the loops would count a reference.
    triangle, depth_m, weights = hits
    height, width = triangle.shape
    across = (np.arange(width) + 0.5 - lens.cx) / lens.fx
    for t in range(faces.shape[0]):
        corners = faces[t, 0], faces[t, 1], faces[t, 2]
        u0, u1, v0, v1 = box_in_image(points, uv, corners)
        i0, i1 = covered_cells(u0, u1, 1.0, 0.5, width)
        j0, j1 = covered_cells(v0, v1, 1.0, 0.5, height)
        if i0 > i1 or j0 > j1:
            continue
        n0x, n0y, n0z, n1x, n1y, n1z, n2x, n2y, n2z, det = edge_planes(points, corners)
        if det == 0.0:
            continue
        if det < 0.0:  # seen from the back
            det = -det
            n0x, n0y, n0z = -n0x, -n0y, -n0z
            n1x, n1y, n1z = -n1x, -n1y, -n1z
            n2x, n2y, n2z = -n2x, -n2y, -n2z
        for j in range(j0, j1 + 1):
            dy = (j + 0.5 - lens.cy) / lens.fy
            r0 = n0y * dy + n0z
            r1 = n1y * dy + n1z
            r2 = n2y * dy + n2z
            for i in range(i0, i1 + 1):
                # Along a row each of these only grows or only falls, rounded as it is.
                dx = across[i]
                e0 = n0x * dx + r0
                if e0 < 0.0:
                    if n0x <= 0.0:
                        break
                    continue
                e1 = n1x * dx + r1
                if e1 < 0.0:
                    if n1x <= 0.0:
                        break
                    continue
                e2 = n2x * dx + r2
                if e2 < 0.0:
                    if n2x <= 0.0:
                        break
                    continue
                if e0 == 0.0 and not owns_edge(n0x, n0y):
                    continue
                if e1 == 0.0 and not owns_edge(n1x, n1y):
                    continue
                if e2 == 0.0 and not owns_edge(n2x, n2y):
                    continue
                total = e0 + e1 + e2
                if total == 0.0:
                    continue
                z = det / total
                if z < depth_m[j, i] and z >= NEAR_M:
                    depth_m[j, i] = z
                    triangle[j, i] = t
                    weights[j, i, 0] = e1 / total
                    weights[j, i, 1] = e2 / total


@inlined
def owns_edge(nx: float, ny: float) -> bool:
    """Return whether a triangle owns the rays that are exactly in its edge plane (nx, ny, .)."""
    return nx > 0.0 or (nx == 0.0 and ny > 0.0)


@compiled
def interpolate(
    triangles: Int32Array, weights: FloatArray, faces: Int32Array, values: FloatArray
) -> FloatArray:
    """Interpolate vertex values inside triangles.

    Args:
        triangles: int32 (N,), rows of `faces`, all >= 0.
        weights: float64 (N, 2), barycentrics of the second and third corner.
        faces: int32 (F, 3).
        values: float64 (V, C), per vertex.

    Returns:
        float64 (N, C).
    """
    out = np.empty((triangles.shape[0], values.shape[1]))
    for n in range(triangles.shape[0]):
        t = triangles[n]
        w1 = weights[n, 0]
        w2 = weights[n, 1]
        w0 = 1.0 - w1 - w2
        for k in range(values.shape[1]):
            out[n, k] = (
                w0 * values[faces[t, 0], k]
                + w1 * values[faces[t, 1], k]
                + w2 * values[faces[t, 2], k]
            )
    return out


@compiled
def rest_seen(
    hits: Hits, first: int, end: int, faces: Int32Array, rest: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return where an image shows a part, and which place of the part.

    Args:
        hits: Of the whole scene.
        first: Row of the part's first triangle in the scene's.
        end: Row after its last one.
        faces: int32 (F, 3), the part's triangles.
        rest: float64 (V, 3), its rest coordinates.

    Returns:
        int64 (N,), pixels counted row by row, ascending; float64 (N, 3), rest coordinates there.
    """
    triangle, _, weights = hits
    height, width = triangle.shape
    count = 0
    for j in range(height):
        for i in range(width):
            count += first <= triangle[j, i] < end
    at, places = np.empty(count, np.int64), np.empty((count, 3))
    n = 0
    for j in range(height):
        for i in range(width):
            t = triangle[j, i] - first
            if t < 0 or t >= end - first:
                continue
            a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
            w1, w2 = weights[j, i, 0], weights[j, i, 1]
            w0 = 1.0 - w1 - w2
            at[n] = j * width + i
            for k in range(3):
                places[n, k] = w0 * rest[a, k] + w1 * rest[b, k] + w2 * rest[c, k]
            n += 1
    return at, places
