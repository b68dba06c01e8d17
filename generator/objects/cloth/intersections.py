"""Where a triangle mesh pokes through itself: edges that pierce triangles."""

from __future__ import annotations

import numpy as np

from pliant.generator.compiled import compiled
from pliant.generator.objects.cloth.cells import grid_over, triangles_in_cells
from pliant.spec.arrays import FloatArray, Int32Array


def find_intersections(vertices: FloatArray, faces: Int32Array, edges: Int32Array) -> Int32Array:
    """Return every edge that properly pierces a triangle it shares no vertex with.

    Args:
        vertices: float64 (V, 3).
        faces: int32 (F, 3).
        edges: int32 (E, 2), every edge of the triangles once.

    Returns:
        int32 (K, 5): the edge's two vertices, then the triangle's three.
    """
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    room = 1024
    while True:
        hits = np.empty((room, 2), np.int32)
        count = _pierced(vertices, faces, edges, float(lengths.mean()), hits)
        if count <= room:
            break
        room = count
    found = hits[:count]
    return np.concatenate([edges[found[:, 0]], faces[found[:, 1]]], axis=1)


@compiled
def _volume(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> float:
    """Six times the signed volume of the tetrahedron pqrs."""
    ax, ay, az = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    bx, by, bz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    cx, cy, cz = s[0] - p[0], s[1] - p[1], s[2] - p[2]
    return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)


@compiled
def _pierced(
    vertices: FloatArray, faces: Int32Array, edges: Int32Array, cell_m: float, hits: Int32Array
) -> int:
    low, edge_m, cells = grid_over(vertices, cell_m, 16.0 * faces.shape[0] + 1024.0)
    start, members = triangles_in_cells(vertices, faces, low, edge_m, cells)
    found = 0
    tested = np.full(faces.shape[0], -1, np.int32)
    first = np.empty(3, np.int64)
    last = np.empty(3, np.int64)
    for e in range(edges.shape[0]):
        i = edges[e, 0]
        j = edges[e, 1]
        for c in range(3):
            first[c] = int((min(vertices[i, c], vertices[j, c]) - low[c]) / edge_m)
            last[c] = int((max(vertices[i, c], vertices[j, c]) - low[c]) / edge_m)
        for x in range(first[0], last[0] + 1):
            for y in range(first[1], last[1] + 1):
                for z in range(first[2], last[2] + 1):
                    k = (x * cells[1] + y) * cells[2] + z
                    for q in range(start[k], start[k + 1]):
                        t = members[q]
                        if tested[t] == e:
                            continue
                        tested[t] = e
                        f, g, h = faces[t, 0], faces[t, 1], faces[t, 2]
                        if i in (f, g, h) or j in (f, g, h):
                            continue
                        p, s = vertices[i], vertices[j]
                        a, b, d = vertices[f], vertices[g], vertices[h]
                        if _volume(a, b, d, p) * _volume(a, b, d, s) >= 0.0:
                            continue
                        one = _volume(p, s, a, b)
                        two = _volume(p, s, b, d)
                        three = _volume(p, s, d, a)
                        if (one > 0.0 and two > 0.0 and three > 0.0) or (
                            one < 0.0 and two < 0.0 and three < 0.0
                        ):
                            if found < hits.shape[0]:
                                hits[found, 0] = e
                                hits[found, 1] = t
                            found += 1
    return found
