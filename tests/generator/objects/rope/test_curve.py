"""Bezier handles, arc length and frames against cases worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pliant.generator.objects.rope.curve import (
    HANDLE_SHARE,
    arc_length,
    automatic_handles,
    bezier_curve,
    resample,
    smooth_curve,
    tightest_bend,
    turned,
    twist_free_frames,
)


def test_handles_bisect_their_neighbours() -> None:
    # A right angle: the tangent at the corner is the diagonal, each handle as long as its side
    # says; at the ends they lie on the chord.
    nodes = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]])
    left, right = automatic_handles(nodes)[1]
    diagonal = np.array([1.0, 1.0]) / math.sqrt(2)
    np.testing.assert_allclose(left, nodes[1] - 2 * HANDLE_SHARE * diagonal)
    np.testing.assert_allclose(right, nodes[1] + 1 * HANDLE_SHARE * diagonal)
    np.testing.assert_allclose(automatic_handles(nodes)[0, 1], [2 * HANDLE_SHARE, 0.0])


def test_a_square_of_nodes_gives_nearly_a_circle() -> None:
    angle = np.pi / 2 * np.arange(-1, 6)
    nodes = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    curve = bezier_curve(nodes, automatic_handles(nodes))
    inner = curve[96:-96]  # without the first and last stretch, whose ends know one neighbour
    np.testing.assert_allclose(np.hypot(*inner.T), 1.0, atol=2e-3)


def test_resampling_is_even_and_keeps_the_ends() -> None:
    t = np.linspace(0, 1, 4000) ** 2
    spiral = np.stack([t * np.cos(9 * t), t * np.sin(9 * t), t], axis=1)
    even = resample(spiral, 200)
    steps = np.diff(arc_length(even))
    # A chord is shorter than its arc by (step * curvature)^2 / 24.
    assert np.ptp(steps) < 3e-3 * steps.mean()
    np.testing.assert_array_equal(even[[0, -1]], spiral[[0, -1]])


@pytest.mark.parametrize("radius", [0.02, 3.0])
def test_tightest_bend_of_a_circle_is_its_radius(radius: float) -> None:
    angle = np.linspace(0, 5, 300)
    circle = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    assert tightest_bend(circle) == pytest.approx(radius)
    assert tightest_bend(np.stack([angle, 0 * angle, 0 * angle], axis=1)) > 1e5


def test_frames_are_orthonormal_and_right_handed() -> None:
    rng = np.random.default_rng(1)
    steps = rng.normal(size=(12, 3)) + np.array([1.0, 0, 0])
    curve = smooth_curve(np.cumsum(steps, axis=0), -np.inf)
    frames = twist_free_frames(curve, np.array([0.0, 0.3, 1.0]))
    unit = np.einsum("nij,nkj->nik", frames, frames)
    np.testing.assert_allclose(unit, np.broadcast_to(np.eye(3), unit.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)


def test_frames_of_a_helix_turn_against_its_torsion() -> None:
    # Against the Frenet normal a twist-free frame turns by minus the integral of torsion:
    # tau = b / (a^2 + b^2), ds = sqrt(a^2 + b^2) dt.
    a, b = 1.0, 0.4
    # Few samples, so that a method of lower order would miss.
    t = np.linspace(0, 6.0, 121)
    helix = np.stack([a * np.cos(t), a * np.sin(t), b * t], axis=1)
    frames = twist_free_frames(helix, np.array([-1.0, 0.0, 0.0]))
    frenet = np.stack([-np.cos(t), -np.sin(t), 0 * t], axis=1)
    tangent = frames[:, 0]
    cosine = (frames[:, 1] * frenet).sum(axis=1)
    sine = (np.cross(frenet, frames[:, 1]) * tangent).sum(axis=1)
    angle = np.unwrap(np.arctan2(sine, cosine))
    expected = -t * b / math.hypot(a, b)
    np.testing.assert_allclose(angle - angle[0], expected, atol=2e-3)


def test_turning_by_the_smallest_rotation() -> None:
    x, y, z = np.eye(3)
    np.testing.assert_allclose(turned(x, x, y), y, atol=1e-15)
    np.testing.assert_allclose(turned(y, x, y), -x, atol=1e-15)
    np.testing.assert_allclose(turned(z, x, y), z, atol=1e-15)


def test_spline_passes_particles_and_never_dips_below_the_floor() -> None:
    points = np.zeros((9, 3))
    points[:, 0] = np.arange(9)
    points[4, 2] = 3.0  # a natural spline would undershoot on both sides
    curve = smooth_curve(points, 0.0, per_segment=10)
    np.testing.assert_allclose(curve[::10, :2], points[:, :2], atol=1e-12)
    assert curve[:, 2].min() >= 0.0
    assert smooth_curve(points, -np.inf)[:, 2].min() < -0.1
    free = smooth_curve(points, -np.inf, per_segment=10)
    np.testing.assert_allclose(free[::10], points, atol=1e-12)
