"""A uniform grid over points or a triangle mesh, for neighbour search."""

from __future__ import annotations

import numpy as np

from pliant.generator.compiled import compiled
from pliant.spec.arrays import FloatArray, Int32Array, IntArray


@compiled
def grid_over(points: FloatArray, edge_m: float, most: float) -> tuple[FloatArray, float, IntArray]:
    """Lay a grid over the box of some points.

    Args:
        points: float64 (N, 3), metres.
        edge_m: Edge of a cell, as long as the grid has few enough cells.
        most: Most cells. In a wide box cells are larger: slower, with the same result.

    Returns:
        float64 (3,), the corner; the edge of a cell; int64 (3,), cells along each axis.
    """
    low = np.empty(3)
    cells = np.empty(3, np.int64)
    for c in range(3):
        low[c] = points[:, c].min()
    while True:
        total = 1.0
        for c in range(3):
            cells[c] = int((points[:, c].max() - low[c]) / edge_m) + 1
            total *= cells[c]
        if total <= most:
            return low, edge_m, cells
        edge_m *= 1.5


@compiled
def triangles_in_cells(
    vertices: FloatArray, faces: Int32Array, low: FloatArray, edge_m: float, cells: IntArray
) -> tuple[IntArray, Int32Array]:
    """List in every cell the triangles whose box touches it.

    Args:
        vertices: float64 (V, 3).
        faces: int32 (F, 3).
        low: float64 (3,), the corner of the grid.
        edge_m: Edge of a cell.
        cells: int64 (3,), cells along each axis; along an axis with one cell, all is in it.

    Returns:
        int64 (cells + 1,): cell (x, y, z) has the members from entry (x * cells[1] + y) * cells[2]
        + z to the next one; int32, the members: triangles in ascending order.
    """
    box = np.empty((faces.shape[0], 6), np.int64)
    start = np.zeros(cells[0] * cells[1] * cells[2] + 1, np.int64)
    for t in range(faces.shape[0]):
        for c in range(3):
            a = vertices[faces[t, 0], c]
            b = vertices[faces[t, 1], c]
            d = vertices[faces[t, 2], c]
            box[t, c] = min(int((min(a, b, d) - low[c]) / edge_m), cells[c] - 1)
            box[t, 3 + c] = min(int((max(a, b, d) - low[c]) / edge_m), cells[c] - 1)
        for x in range(box[t, 0], box[t, 3] + 1):
            for y in range(box[t, 1], box[t, 4] + 1):
                for z in range(box[t, 2], box[t, 5] + 1):
                    start[(x * cells[1] + y) * cells[2] + z + 1] += 1
    for k in range(start.shape[0] - 1):
        start[k + 1] += start[k]
    filled = start.copy()
    members = np.empty(start[-1], np.int32)
    for t in range(faces.shape[0]):
        for x in range(box[t, 0], box[t, 3] + 1):
            for y in range(box[t, 1], box[t, 4] + 1):
                for z in range(box[t, 2], box[t, 5] + 1):
                    k = (x * cells[1] + y) * cells[2] + z
                    members[filled[k]] = t
                    filled[k] += 1
    return start, members
