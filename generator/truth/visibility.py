"""Whether a material point is seen, decided against the deformed surface itself.

A point is hidden if a triangle crosses the ray from the camera to it. No depth image is
involved: the ray passes through the point's own sub-pixel position, and each triangle whose
box in the image covers that position is intersected with it by the rasteriser's formula.

The triangles at a surface point's own vertex are left out: their planes hold the point, so they
meet its ray there and nowhere else, and an edge-on one would only add rounding. Of the others,
a hit counts if it is nearer by more than `SAME_SURFACE_M`. That is 1 micrometre: above the
rounding of float32 positions (0.06 micrometres at 1 m) that separates vertices lying at one
place (a seam, a cap), and a thousandth of the thinnest thing a scene holds.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt
from numba import njit

from pliant.generator.scene.camera import NEAR_M, Camera
from pliant.generator.scene.scene_object import FloatArray, IntArray

SAME_SURFACE_M: Final = 1e-6
"""A hit nearer than the point by no more than this is the point's own surface."""

_CELL_PX: Final = 4
# Side of the cells that the points are sorted into, px.


def inside_frame(camera: Camera, uvz: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which projected points lie in the image, as the float32 of the files sees them.

    Args:
        camera: The camera.
        uvz: float64 (N, 3), as `Camera.project` gives.

    Returns:
        bool (N,): 0 <= u < width, 0 <= v < height, and not behind the camera.
    """
    u, v = uvz[:, 0].astype(np.float32), uvz[:, 1].astype(np.float32)
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    found: npt.NDArray[np.bool_] = inside & (uvz[:, 2] >= NEAR_M)
    return found


def first_occluders(
    camera: Camera,
    points_camera: FloatArray,
    own_vertex: IntArray,
    mesh_camera: FloatArray,
    faces: IntArray,
) -> tuple[IntArray, FloatArray]:
    """Return the nearest triangle between the camera and each point.

    Args:
        camera: Intrinsics and image size.
        points_camera: float64 (N, 3), camera axes, metres; all inside the frame.
        own_vertex: int32 (N,), the vertex each point is, or -1.
        mesh_camera: float64 (V, 3), vertices in the camera's axes, metres.
        faces: int32 (F, 3).

    Returns:
        int32 (N,), the triangle, -1 where the point is seen; float64 (N, 2), where in it the
        ray passes (barycentrics of the second and third corner).
    """
    uv = camera.to_pixels(points_camera)[:, :2]
    columns = -(-camera.width // _CELL_PX)
    rows = -(-camera.height // _CELL_PX)
    cells = np.clip(uv // _CELL_PX, 0, [columns - 1, rows - 1]).astype(np.int64)
    cell = cells[:, 1] * columns + cells[:, 0]
    order = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[order], np.arange(rows * columns + 1))
    rays = points_camera[order] / points_camera[order, 2:3]
    triangle = np.full(len(order), -1, np.int32)
    weights = np.zeros((len(order), 2))
    _cast(
        rays,
        np.ascontiguousarray(points_camera[order, 2] - SAME_SURFACE_M),
        own_vertex[order].astype(np.int32),
        starts,
        columns,
        rows,
        np.ascontiguousarray(mesh_camera),
        camera.to_pixels(mesh_camera)[:, :2],
        faces,
        triangle,
        weights,
    )
    found, place = np.empty_like(triangle), np.empty_like(weights)
    found[order], place[order] = triangle, weights
    return found, place


@njit(cache=True, nogil=True)
def _cast(
    rays: FloatArray,
    nearest: FloatArray,
    own: IntArray,
    starts: npt.NDArray[np.int64],
    columns: int,
    rows: int,
    points: FloatArray,
    uv: FloatArray,
    faces: IntArray,
    triangle: IntArray,
    weights: FloatArray,
) -> None:
    """Intersect every triangle with the rays whose cell its box in the image touches."""
    for t in range(faces.shape[0]):
        a = faces[t, 0]
        b = faces[t, 1]
        c = faces[t, 2]
        az = points[a, 2]
        bz = points[b, 2]
        cz = points[c, 2]
        if az >= NEAR_M and bz >= NEAR_M and cz >= NEAR_M:
            low = min(uv[a, 0], uv[b, 0], uv[c, 0]) - 1e-6
            high = max(uv[a, 0], uv[b, 0], uv[c, 0]) + 1e-6
            i0 = max(0, int(np.floor(max(low, -9.0) / _CELL_PX)))
            i1 = min(columns - 1, int(np.floor(min(high, 1e6) / _CELL_PX)))
            low = min(uv[a, 1], uv[b, 1], uv[c, 1]) - 1e-6
            high = max(uv[a, 1], uv[b, 1], uv[c, 1]) + 1e-6
            j0 = max(0, int(np.floor(max(low, -9.0) / _CELL_PX)))
            j1 = min(rows - 1, int(np.floor(min(high, 1e6) / _CELL_PX)))
        elif az < NEAR_M and bz < NEAR_M and cz < NEAR_M:
            continue
        else:
            i0, i1, j0, j1 = 0, columns - 1, 0, rows - 1
        if i0 > i1 or j0 > j1:
            continue
        ready = False
        n0x = n0y = n0z = n1x = n1y = n1z = n2x = n2y = n2z = det = side = 0.0
        for j in range(j0, j1 + 1):
            for n in range(starts[j * columns + i0], starts[j * columns + i1 + 1]):
                if own[n] == a or own[n] == b or own[n] == c:
                    continue
                if not ready:
                    ready = True
                    ax = points[a, 0]
                    ay = points[a, 1]
                    bx = points[b, 0]
                    by = points[b, 1]
                    cx = points[c, 0]
                    cy = points[c, 1]
                    n0x = by * cz - bz * cy
                    n0y = bz * cx - bx * cz
                    n0z = bx * cy - by * cx
                    n1x = cy * az - cz * ay
                    n1y = cz * ax - cx * az
                    n1z = cx * ay - cy * ax
                    n2x = ay * bz - az * by
                    n2y = az * bx - ax * bz
                    n2z = ax * by - ay * bx
                    det = ax * n0x + ay * n0y + az * n0z
                    side = 1.0 if det > 0.0 else -1.0
                e0 = side * (n0x * rays[n, 0] + n0y * rays[n, 1] + n0z)
                e1 = side * (n1x * rays[n, 0] + n1y * rays[n, 1] + n1z)
                e2 = side * (n2x * rays[n, 0] + n2y * rays[n, 1] + n2z)
                total = e0 + e1 + e2
                if e0 < 0.0 or e1 < 0.0 or e2 < 0.0 or total <= 0.0:
                    continue
                z = side * det / total
                if NEAR_M <= z < nearest[n]:
                    nearest[n] = z
                    triangle[n] = t
                    weights[n, 0] = e1 / total
                    weights[n, 1] = e2 / total
