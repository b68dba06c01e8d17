"""Whether a material point is seen, decided against the deformed surface itself.

A point is hidden if a triangle crosses the ray from the camera to it. No depth image is
involved: the ray passes through the point's own sub-pixel position, and each triangle whose
box in the image covers that position is intersected with it by the rasteriser's formula.

The triangles at a surface point's own vertex, or on both sides of its own edge, are left out:
their planes contain the point, so they meet its ray there and nowhere else, and an edge-on one
would only add rounding. Of the others,
a hit counts if it is nearer by more than `SAME_SURFACE_M`. That is 1 micrometre: above the
rounding of float32 positions (0.06 micrometres at 1 m) that separates vertices lying at one
place (a seam, a cap), and a thousandth of the thinnest thing a scene holds.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from pliant.generator.compiled import compiled
from pliant.generator.scene.camera import NEAR_M
from pliant.generator.truth.rasteriser import box_in_image, covered_cells, edge_planes
from pliant.spec.arrays import BoolArray, FloatArray, Int32Array, IntArray
from pliant.spec.camera import Camera

SAME_SURFACE_M: Final = 1e-6
"""A hit nearer than the point by no more than this is the point's own surface."""

_CELL_PX: Final = 4
# Side of the cells that the points are sorted into, px.


def inside_frame(camera: Camera, uvz: FloatArray) -> BoolArray:
    """Return which projected points are in the image, as the float32 of the files sees them.

    Args:
        camera: The camera.
        uvz: float64 (N, 3), as `Camera.project` gives.

    Returns:
        bool (N,): 0 <= u < width, 0 <= v < height, and not behind the camera.
    """
    u, v = uvz[:, 0].astype(np.float32), uvz[:, 1].astype(np.float32)
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    found: BoolArray = inside & (uvz[:, 2] >= NEAR_M)
    return found


def first_occluders(
    camera: Camera,
    points_camera: FloatArray,
    own_edge: Int32Array,
    mesh_camera: FloatArray,
    faces: Int32Array,
) -> tuple[Int32Array, FloatArray]:
    """Return the nearest triangle between the camera and each point.

    Args:
        camera: Intrinsics and image size.
        points_camera: float64 (N, 3), camera axes, metres; all inside the frame.
        own_edge: int32 (N, 2), ends of the edge that each point is on: twice the same vertex
            where it is that vertex, -1 where it is on no surface.
        mesh_camera: float64 (V, 3), vertices in the camera's axes, metres.
        faces: int32 (F, 3).

    Returns:
        int32 (N,), the triangle, -1 where the point is seen; float64 (N, 2), where in it the
        ray passes (barycentrics of the second and third corner).
    """
    uv = camera.to_pixels(points_camera)[:, :2]
    columns = -(-camera.width // _CELL_PX)
    rows = -(-camera.height // _CELL_PX)
    cells = np.maximum(uv // _CELL_PX, 0).astype(np.int64)  # float32 rounds -1e-46 up
    cell = cells[:, 1] * columns + cells[:, 0]
    order = np.argsort(cell, kind="stable")
    starts = np.zeros(rows * columns + 1, np.int64)
    np.cumsum(np.bincount(cell, minlength=rows * columns), out=starts[1:])
    rays = points_camera[order] / points_camera[order, 2:3]
    triangle = np.full(len(order), -1, np.int32)
    weights = np.zeros((len(order), 2))
    sorted_rays = _Rays(
        np.ascontiguousarray(uv[order]),
        rays,
        np.ascontiguousarray(points_camera[order, 2] - SAME_SURFACE_M),
        own_edge[order].astype(np.int32),
        starts,
        (columns, rows),
    )
    mesh = np.ascontiguousarray(mesh_camera)
    _cast(sorted_rays, mesh, camera.to_pixels(mesh_camera)[:, :2], faces, triangle, weights)
    found, place = np.empty_like(triangle), np.empty_like(weights)
    found[order], place[order] = triangle, weights
    return found, place


class _Rays(NamedTuple):
    """Rays from the camera to points, in the order of the image's cells.

    Attributes:
        uv: float64 (N, 2), where the image shows the points, px.
        direction: float64 (N, 3), z is 1.
        nearest: float64 (N,), a hit counts if it is nearer than this; lowered to each hit.
        own: int32 (N, 2), ends of the edge each point is on, or -1.
        starts: int64, per cell its first ray, and last the number of rays.
        size: Columns and rows of cells.
    """

    uv: FloatArray
    direction: FloatArray
    nearest: FloatArray
    own: Int32Array
    starts: IntArray
    size: tuple[int, int]


@compiled
def _cast(
    rays: _Rays,
    points: FloatArray,
    uv: FloatArray,
    faces: Int32Array,
    triangle: Int32Array,
    weights: FloatArray,
) -> None:
    """Intersect every triangle with the rays that pass its box in the image."""
    # Each look into a tuple of arrays inside the loops would count a reference.
    seen, direction, nearest, owns, starts, size = rays
    columns, rows = size
    for t in range(faces.shape[0]):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        u0, u1, v0, v1 = box_in_image(points, uv, (a, b, c))
        i0, i1 = covered_cells(u0, u1, float(_CELL_PX), 1.0, columns)
        j0, j1 = covered_cells(v0, v1, float(_CELL_PX), 1.0, rows)
        if i0 > i1 or j0 > j1:
            continue
        ready = False
        n0x = n0y = n0z = n1x = n1y = n1z = n2x = n2y = n2z = det = side = 0.0
        for j in range(j0, j1 + 1):
            for n in range(starts[j * columns + i0], starts[j * columns + i1 + 1]):
                u, v = seen[n, 0], seen[n, 1]
                if u < u0 or u > u1 or v < v0 or v > v1:
                    continue
                own, end = owns[n, 0], owns[n, 1]
                if (own in (a, b, c)) and (end in (a, b, c)):
                    continue
                if not ready:
                    ready = True
                    n0x, n0y, n0z, n1x, n1y, n1z, n2x, n2y, n2z, det = edge_planes(
                        points, (a, b, c)
                    )
                    side = 1.0 if det > 0.0 else -1.0
                x, y = direction[n, 0], direction[n, 1]
                e0 = side * (n0x * x + n0y * y + n0z)
                e1 = side * (n1x * x + n1y * y + n1z)
                e2 = side * (n2x * x + n2y * y + n2z)
                total = e0 + e1 + e2
                if e0 < 0.0 or e1 < 0.0 or e2 < 0.0 or total <= 0.0:
                    continue
                z = side * det / total
                if NEAR_M <= z < nearest[n]:
                    nearest[n] = z
                    triangle[n] = t
                    weights[n, 0] = e1 / total
                    weights[n, 1] = e2 / total
