"""Curves in space: Bezier control points with automatic handles, splines, arc length, frames."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pliant.generator.compiled import compiled
from pliant.generator.portable import norm
from pliant.spec.arrays import FloatArray

HANDLE_SHARE: Final = 0.39
"""Length of an automatic handle over the distance to that neighbour (near a circle's 0.3905
for neighbours a right angle apart)."""


def automatic_handles(nodes: FloatArray) -> FloatArray:
    """Return the two handles of every control point, along the bisector of its neighbours.

    Args:
        nodes: float64 (n, d), control points, n >= 2.

    Returns:
        float64 (n, 2, d): left and right handle. At an end the handles are on the chord.
    """
    steps = np.diff(nodes, axis=0)  # (n - 1, d)
    lengths = np.sqrt((steps**2).sum(axis=1))[:, None]
    units = steps / np.maximum(lengths, 1e-12)
    before = np.concatenate([units[:1], units])
    after = np.concatenate([units, units[-1:]])
    tangent = before + after
    tangent /= np.maximum(np.sqrt((tangent**2).sum(axis=1))[:, None], 1e-12)
    left_length = np.concatenate([lengths[:1], lengths])
    right_length = np.concatenate([lengths, lengths[-1:]])
    left = nodes - HANDLE_SHARE * left_length * tangent
    right = nodes + HANDLE_SHARE * right_length * tangent
    return np.stack([left, right], axis=1)


def bezier_curve(nodes: FloatArray, handles: FloatArray, per_segment: int = 96) -> FloatArray:
    """Return points on the cubic Bezier curve through the control points.

    Args:
        nodes: float64 (n, d).
        handles: float64 (n, 2, d).
        per_segment: Points per stretch between two control points.

    Returns:
        float64 ((n - 1) * per_segment + 1, d), the first and last node among them.
    """
    t = (np.arange(per_segment) / per_segment)[None, :, None]
    u = 1.0 - t
    a, b = nodes[:-1, None], handles[:-1, 1][:, None]
    c, d = handles[1:, 0][:, None], nodes[1:, None]
    points = u * u * u * a + 3.0 * u * u * t * b + 3.0 * u * t * t * c + t * t * t * d
    return np.concatenate([points.reshape(-1, nodes.shape[1]), nodes[-1:]])


def arc_length(points: FloatArray) -> FloatArray:
    """Return the length of the polyline up to each of its points.

    Args:
        points: float64 (n, d).

    Returns:
        float64 (n,), the first entry 0.
    """
    steps = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    return np.concatenate([np.zeros(1), np.cumsum(steps)])


def resample(points: FloatArray, count: int) -> FloatArray:
    """Return `count` points at equal arc length along a polyline, both ends among them.

    Args:
        points: float64 (n, d).
        count: How many, >= 2.

    Returns:
        float64 (count, d).
    """
    length = arc_length(points)
    wanted = np.linspace(0.0, length[-1], count)
    columns = [np.interp(wanted, length, points[:, k]) for k in range(points.shape[1])]
    return np.stack(columns, axis=1)


def tightest_bend(points: FloatArray) -> float:
    """Return the smallest radius of curvature of an evenly sampled polyline.

    Args:
        points: float64 (n, d), metres, equal steps.

    Returns:
        Radius of the circle through three successive points, metres; inf if straight.
    """
    before, after = points[1:-1] - points[:-2], points[2:] - points[1:-1]
    chord = points[2:] - points[:-2]
    a2, b2, c2 = ((each**2).sum(axis=1) for each in (before, after, chord))
    # 16 * area^2 of the triangle; the circumradius is a b c / (4 area).
    area = np.maximum(4 * a2 * b2 - (a2 + b2 - c2) ** 2, 0.0)
    with np.errstate(divide="ignore"):
        return float(np.sqrt(a2 * b2 * c2 / area).min())


@compiled
def _make_normal(vector: FloatArray, tangent: FloatArray) -> None:
    """Turn a vector into the unit vector at right angles to a tangent that is nearest to it."""
    along = 0.0
    for c in range(3):
        along += vector[c] * tangent[c]
    length = 0.0
    for c in range(3):
        vector[c] -= along * tangent[c]
        length += vector[c] ** 2
    length = math.sqrt(length)
    for c in range(3):
        vector[c] /= length


@compiled
def twist_free_frames(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the rotation-minimising frame along a curve.

    Double reflection (Wang, Juettler, Zheng, Liu 2008, "Computation of rotation minimizing
    frames", section 4).

    Args:
        points: float64 (n, 3), metres.
        normal: float64 (3,), direction wanted for the first normal; it is made to stand at
            right angles to the tangent and must not be parallel to it.

    Returns:
        float64 (n, 3, 3): tangent, normal, binormal (their cross product) of each point.
    """
    n = points.shape[0]
    tangents, normals = np.empty((n, 3)), np.empty((n, 3))
    normals[0] = normal
    for i in range(n):
        # Central differences inside, one-sided at the ends.
        low = max(i - 1, 0)
        high = min(i + 1, n - 1)
        length = 0.0
        for c in range(3):
            tangents[i, c] = points[high, c] - points[low, c]
            length += tangents[i, c] ** 2
        length = math.sqrt(length)
        for c in range(3):
            tangents[i, c] /= length
    _make_normal(normals[0], tangents[0])
    for i in range(n - 1):
        # Two reflections: one along the step, one along what is left of the tangent.
        c1 = 0.0
        dot_normal = 0.0
        dot_tangent = 0.0
        for c in range(3):
            step = points[i + 1, c] - points[i, c]
            c1 += step * step
            dot_normal += step * normals[i, c]
            dot_tangent += step * tangents[i, c]
        c2 = 0.0
        dot = 0.0
        rest = np.empty(3)
        for c in range(3):
            step = points[i + 1, c] - points[i, c]
            normals[i + 1, c] = normals[i, c] - 2.0 / c1 * dot_normal * step
            rest[c] = tangents[i + 1, c] - (tangents[i, c] - 2.0 / c1 * dot_tangent * step)
            c2 += rest[c] * rest[c]
            dot += rest[c] * normals[i + 1, c]
        if c2 > 1e-24:
            for c in range(3):
                normals[i + 1, c] -= 2.0 / c2 * dot * rest[c]
        # Keep it a unit vector at right angles against the drift of rounding.
        _make_normal(normals[i + 1], tangents[i + 1])
    return np.stack((tangents, normals, np.cross(tangents, normals)), axis=1)


def turned(vector: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return `vector` turned by the smallest rotation that takes one direction to another.

    Args:
        vector: float64 (3,).
        before: float64 (3,), unit direction.
        after: float64 (3,), unit direction, not opposite to `before`.

    Returns:
        float64 (3,).
    """
    axis = np.cross(before, after)
    cosine = float((before * after).sum())
    along = float((axis * vector).sum()) / max(1.0 + cosine, 1e-12)
    return cosine * vector + np.cross(axis, vector) + along * axis


@compiled
def smooth_curve(points: FloatArray, floor_m: float, per_segment: int = 24) -> FloatArray:
    """Return points on the natural cubic spline through equally spaced particles.

    Args:
        points: float64 (n, 3), n >= 3, metres.
        floor_m: Least height, metres. Where particles rise steeply from it the curve passes
            above them rather than dip below it in between.
        per_segment: Points per stretch between two particles.

    Returns:
        float64 ((n - 1) * per_segment + 1, 3), metres.
    """
    n = points.shape[0]
    out = np.empty(((n - 1) * per_segment + 1, 3))
    share = np.empty(n)
    control = np.empty((n + 2, 3))
    # Control points of the uniform cubic B-spline that passes through the particles, straight
    # at both ends: (c[i-1] + 4 c[i] + c[i+1]) / 6 = p[i], a tridiagonal system.
    for c in range(3):
        control[1, c] = points[0, c]
        control[n, c] = points[n - 1, c]
    share[0] = 0.0
    for i in range(1, n - 1):
        pivot = 4.0 - share[i - 1]
        share[i] = 1.0 / pivot
        for c in range(3):
            control[i + 1, c] = (6.0 * points[i, c] - control[i, c]) / pivot
    for i in range(n - 2, 0, -1):
        for c in range(3):
            control[i + 1, c] -= share[i] * control[i + 2, c]
    # A B-spline stays within its control points: none below the floor, no dip into the table.
    for i in range(1, n + 1):
        control[i, 2] = max(control[i, 2], floor_m)
    for c in range(3):
        control[0, c] = 2.0 * control[1, c] - control[2, c]
        control[n + 1, c] = 2.0 * control[n, c] - control[n - 1, c]
    for i in range(n - 1):
        for k in range(per_segment):
            t = k / per_segment
            u = 1.0 - t
            for c in range(3):
                out[i * per_segment + k, c] = (
                    u * u * u * control[i, c]
                    + (3.0 * t**3 - 6.0 * t * t + 4.0) * control[i + 1, c]
                    + (3.0 * u**3 - 6.0 * u * u + 4.0) * control[i + 2, c]
                    + t * t * t * control[i + 3, c]
                ) / 6.0
    for c in range(3):
        out[(n - 1) * per_segment, c] = points[n - 1, c]
    out[(n - 1) * per_segment, 2] = max(points[n - 1, 2], floor_m)
    return out


def first_direction(chain: FloatArray) -> FloatArray:
    """Return the unit direction of the first stretch of points (n, 3): float64 (3,)."""
    step = chain[1] - chain[0]
    return step / norm(step)
