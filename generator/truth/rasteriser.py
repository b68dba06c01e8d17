"""An exact rasteriser: which triangle lies under a pixel's centre, where in it, and how deep.

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

from dataclasses import dataclass

import numpy as np
from numba import njit

from pliant.generator.scene.camera import NEAR_M, Camera
from pliant.generator.scene.scene_object import FloatArray, IntArray


@dataclass(frozen=True)
class Hits:
    """What each pixel's centre sees.

    Attributes:
        triangle: int32 (H, W), row of the faces, -1 where nothing is seen.
        depth_m: float64 (H, W), planar z, +inf where nothing is seen.
        weights: float64 (H, W, 2), barycentrics of the triangle's second and third corner.
    """

    triangle: IntArray
    depth_m: FloatArray
    weights: FloatArray


def rasterise(camera: Camera, points_camera: FloatArray, faces: IntArray, scale: int = 1) -> Hits:
    """Find the nearest triangle at the centre of every pixel.

    Args:
        camera: Intrinsics and image size.
        points_camera: float64 (V, 3), vertices in the camera's axes, metres.
        faces: int32 (F, 3).
        scale: Samples a side of a pixel; 2 gives an image of twice the width and height.

    Returns:
        The hits; arrays of (height * scale, width * scale).
    """
    height, width = camera.height * scale, camera.width * scale
    triangle = np.full((height, width), -1, np.int32)
    depth_m = np.full((height, width), np.inf)
    weights = np.zeros((height, width, 2))
    uv_px = camera.to_pixels(points_camera)[:, :2] * scale
    k = camera.K * scale
    rasterise_into(
        np.ascontiguousarray(points_camera),
        uv_px,
        faces,
        k[0, 0],
        k[1, 1],
        k[0, 2],
        k[1, 2],
        triangle,
        depth_m,
        weights,
    )
    return Hits(triangle, depth_m, weights)


@njit(cache=True, nogil=True)
def rasterise_into(
    points: FloatArray,
    uv: FloatArray,
    faces: IntArray,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    triangle: IntArray,
    depth: FloatArray,
    weights: FloatArray,
) -> None:
    """Rasterise into arrays that hold -1, +inf and anything; see `rasterise`.

    Args:
        points: float64 (V, 3), camera axes, metres.
        uv: float64 (V, 2), their projections, px.
        faces: int32 (F, 3).
        fx: Focal length, px.
        fy: Focal length, px.
        cx: Principal point, px.
        cy: Principal point, px.
        triangle: int32 (H, W), written.
        depth: float64 (H, W), written.
        weights: float64 (H, W, 2), written.
    """
    height, width = triangle.shape
    for t in range(faces.shape[0]):
        a = faces[t, 0]
        b = faces[t, 1]
        c = faces[t, 2]
        az = points[a, 2]
        bz = points[b, 2]
        cz = points[c, 2]
        if az >= NEAR_M and bz >= NEAR_M and cz >= NEAR_M:
            # A pixel is tried if its centre lies in the box of the corners, widened by far more
            # than the projection's rounding.
            low = min(uv[a, 0], uv[b, 0], uv[c, 0])
            high = max(uv[a, 0], uv[b, 0], uv[c, 0])
            i0 = max(0, int(np.ceil(max(low, -1.0) - 0.5 - 1e-6)))
            i1 = min(width - 1, int(np.floor(min(high, width + 1.0) - 0.5 + 1e-6)))
            low = min(uv[a, 1], uv[b, 1], uv[c, 1])
            high = max(uv[a, 1], uv[b, 1], uv[c, 1])
            j0 = max(0, int(np.ceil(max(low, -1.0) - 0.5 - 1e-6)))
            j1 = min(height - 1, int(np.floor(min(high, height + 1.0) - 0.5 + 1e-6)))
            if i0 > i1 or j0 > j1:
                continue
        elif az < NEAR_M and bz < NEAR_M and cz < NEAR_M:
            continue
        else:
            i0, i1, j0, j1 = 0, width - 1, 0, height - 1
        ax = points[a, 0]
        ay = points[a, 1]
        bx = points[b, 0]
        by = points[b, 1]
        cx_ = points[c, 0]
        cy_ = points[c, 1]
        n0x = by * cz - bz * cy_
        n0y = bz * cx_ - bx * cz
        n0z = bx * cy_ - by * cx_
        n1x = cy_ * az - cz * ay
        n1y = cz * ax - cx_ * az
        n1z = cx_ * ay - cy_ * ax
        n2x = ay * bz - az * by
        n2y = az * bx - ax * bz
        n2z = ax * by - ay * bx
        det = ax * n0x + ay * n0y + az * n0z
        if det == 0.0:
            continue
        side = 1.0 if det > 0.0 else -1.0
        for j in range(j0, j1 + 1):
            dy = (j + 0.5 - cy) / fy
            r0 = n0y * dy + n0z
            r1 = n1y * dy + n1z
            r2 = n2y * dy + n2z
            for i in range(i0, i1 + 1):
                dx = (i + 0.5 - cx) / fx
                e0 = side * (n0x * dx + r0)
                if e0 < 0.0:
                    continue
                e1 = side * (n1x * dx + r1)
                if e1 < 0.0:
                    continue
                e2 = side * (n2x * dx + r2)
                if e2 < 0.0:
                    continue
                if e0 == 0.0 and not owns_edge(side * n0x, side * n0y):
                    continue
                if e1 == 0.0 and not owns_edge(side * n1x, side * n1y):
                    continue
                if e2 == 0.0 and not owns_edge(side * n2x, side * n2y):
                    continue
                total = e0 + e1 + e2
                if total == 0.0:
                    continue
                z = side * det / total
                if z < depth[j, i] and z >= NEAR_M:
                    depth[j, i] = z
                    triangle[j, i] = t
                    weights[j, i, 0] = e1 / total
                    weights[j, i, 1] = e2 / total


@njit(cache=True, inline="always")
def owns_edge(nx: float, ny: float) -> bool:
    """Return whether a triangle owns the rays that lie exactly in its edge plane (nx, ny, .)."""
    return nx > 0.0 or (nx == 0.0 and ny > 0.0)


@njit(cache=True, nogil=True)
def interpolate(
    triangles: IntArray, weights: FloatArray, faces: IntArray, values: FloatArray
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
