"""Self-intersections of a mesh counted another way, to check `pliant.generator.objects.cloth`.

The package walks a grid of cells and decides by signs of volumes. Here candidates come from
a k-d tree and each is decided by Möller and Trumbore's ray against the triangle; numpy and
scipy alone, nothing of the package.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from pliant.spec.arrays import FloatArray

_CHUNK = 200_000


def count_intersections(vertices: FloatArray, faces: npt.NDArray[np.int32]) -> int:
    """Return how many (edge, triangle) pairs without a common vertex cross.

    Args:
        vertices: float64 (V, 3).
        faces: int32 (F, 3).
    """
    edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    ends = vertices[edges]
    corners = vertices[faces]
    centroids = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centroids[:, None], axis=2).max()
    middles = ends.mean(axis=1)
    half = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
    tree = cKDTree(centroids)
    total = 0
    for first in range(0, len(edges), 20_000):
        block = slice(first, first + 20_000)
        near = tree.query_ball_point(middles[block], half[block] + reach)
        sizes = np.array([len(n) for n in near])
        edge = np.repeat(np.arange(first, first + len(sizes)), sizes)
        face = np.concatenate([np.asarray(n, dtype=np.int64) for n in near])
        apart = ~(edges[edge][:, :, None] == faces[face][:, None, :]).any(axis=(1, 2))
        edge, face = edge[apart], face[apart]
        for start in range(0, len(edge), _CHUNK):
            chunk = slice(start, start + _CHUNK)
            total += int(_crosses(ends[edge[chunk]], corners[face[chunk]]).sum())
    return total


def _crosses(segment: FloatArray, triangle: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether each segment (N, 2, 3) crosses its triangle (N, 3, 3)."""
    origin, direction = segment[:, 0], segment[:, 1] - segment[:, 0]
    one = triangle[:, 1] - triangle[:, 0]
    two = triangle[:, 2] - triangle[:, 0]
    p = np.cross(direction, two)
    determinant = (one * p).sum(axis=1)
    lengths = np.linalg.norm(direction, axis=1) * np.linalg.norm(np.cross(one, two), axis=1)
    skew = np.abs(determinant) > 1e-12 * lengths  # else the segment lies along the plane
    inverse = 1.0 / np.where(skew, determinant, 1.0)
    t = origin - triangle[:, 0]
    u = (t * p).sum(axis=1) * inverse
    q = np.cross(t, one)
    v = (direction * q).sum(axis=1) * inverse
    s = (two * q).sum(axis=1) * inverse
    return skew & (u > 0) & (v > 0) & (u + v < 1) & (s > 0) & (s < 1)
