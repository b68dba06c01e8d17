"""The surfaces of rope and ball: strands in the straight rope, and the same along a curve.

A vertex is known by its rest coordinates (s * L, a, b) in metres: how far along the rope, and
where in its cross section. Every cross section of the mesh is in one plane of constant s, so
that bending the rope never interpolates between samples of its centre line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pliant.generator import portable
from pliant.generator.scene.scene_object import Chart, quads
from pliant.generator.settings.rope import RopeSettings
from pliant.spec.arrays import BoolArray, FloatArray, Int32Array

BALL_DEPTH: Final = 0.8
"""The rope's end is this share of the ball's radius away from the ball's centre."""

_RINGS: Final = 24


@dataclass(frozen=True)
class RopeMesh:
    """Topology and rest shape of the rope.

    Attributes:
        rest: float64 (V, 3), (s * L, a, b), metres.
        faces: int32 (F, 3), outward winding.
        strand: int32 (V,).
        row: int32 (V,), cross section of the vertex.
        mirror: int32 (V,), the vertex on which the reversal (s, a, b) -> (L - s, a, -b) lands.
        outer: bool (V,), no other strand is outside the vertex in its cross section.
    """

    rest: FloatArray
    faces: Int32Array
    strand: Int32Array
    row: Int32Array
    mirror: Int32Array
    outer: BoolArray


def rope_mesh(settings: RopeSettings) -> RopeMesh:
    """Return the mesh of a straight rope.

    Args:
        settings: Structure, proportions and resolution.

    Returns:
        The mesh; it is symmetric under the reversal to the last bit of a and b.
    """
    sections = _sections(settings)  # (strands, rows, ring, 2)
    strands, rows, ring, _ = sections.shape
    mirror_strand = -np.arange(strands) % strands
    mirror_ring = -np.arange(ring) % ring
    reversed_sections = sections[mirror_strand][:, ::-1][:, :, mirror_ring] * [1.0, -1.0]
    sections = (sections + reversed_sections) / 2.0

    index = np.arange(strands * rows * ring, dtype=np.int32).reshape(strands, rows, ring)
    mirror = index[mirror_strand][:, ::-1][:, :, mirror_ring].reshape(-1)
    along = np.linspace(0.0, settings.length_m, rows)
    along = (along + (settings.length_m - along[::-1])) / 2.0
    rest = np.empty((strands, rows, ring, 3))
    rest[..., 0] = along[None, :, None]
    rest[..., 1:] = sections
    strand, row, _ = np.unravel_index(np.arange(index.size), index.shape)
    return RopeMesh(
        rest=rest.reshape(-1, 3),
        faces=_faces(index),
        strand=strand.astype(np.int32),
        row=row.astype(np.int32),
        mirror=mirror.astype(np.int32),
        outer=_outer(sections).reshape(-1),
    )


def rope_chart(length_m: float) -> Chart:
    """Return the chart (s * L, a, b) -> (s, theta).

    Args:
        length_m: Length of the rope, metres.

    Returns:
        A function of float64 (N, 3) to float64 (N, 2): s in 0..1, theta in radians.
    """

    def chart(rest: FloatArray) -> FloatArray:
        return np.stack([rest[:, 0] / length_m, portable.arctan2(rest[:, 2], rest[:, 1])], axis=1)

    return chart


def bend(mesh: RopeMesh, centreline: FloatArray, frames: FloatArray) -> FloatArray:
    """Return the vertices of the rope along a curve.

    Args:
        mesh: The straight rope.
        centreline: float64 (rows, 3), metres, at equal arc length.
        frames: float64 (rows, 3, 3): tangent, normal, binormal.

    Returns:
        float64 (V, 3), metres.
    """
    row = mesh.row
    return np.asarray(
        centreline[row] + mesh.rest[:, 1:2] * frames[row, 1] + mesh.rest[:, 2:3] * frames[row, 2]
    )


def _sections(settings: RopeSettings) -> FloatArray:
    """Return the outline of each strand in each cross section: (strands, rows, ring, 2)."""
    s = np.linspace(0.0, 1.0, settings.rows)
    radius = settings.radius_m
    if settings.structure == "tube":
        turn = 2.0 * math.pi * np.arange(3 * settings.ring) / (3 * settings.ring)
        circle = radius * np.stack([portable.cos(turn), portable.sin(turn)], axis=-1)
        return np.broadcast_to(circle, (1, settings.rows, *circle.shape)).copy()
    turn = 2.0 * math.pi * np.arange(settings.ring) / settings.ring
    wave = 2.0 * math.pi * settings.turns
    # Equal strands side by side; cut at right angles to the rope they are wider than high,
    # and pressed a little into each other so that no light falls between them. The polygon of a
    # strand is narrower than its ellipse: its widest corner, seen from the rope's centre, must
    # reach beyond the ray midway between two strands.
    height = settings.strand_radius_m
    axis_radius = radius - height
    lay_angle = math.atan(wave / settings.length_m * axis_radius)
    sides = turn[1 : settings.ring // 2]
    corners = (axis_radius + height * portable.cos(sides)) / portable.sin(sides)
    midway = math.tan(math.pi / settings.strands) * float(corners.min())
    width = max(1.04 * height / math.cos(lay_angle), 1.02 * midway)
    strand = 2.0 * math.pi * np.arange(settings.strands)[:, None] / settings.strands
    phase = strand + wave * s
    radial = (axis_radius + height * portable.cos(turn))[None, None]
    sideways = width * portable.sin(turn)
    cos, sin = portable.cos(phase)[..., None], portable.sin(phase)[..., None]
    outline = np.stack([radial * cos - sideways * sin, radial * sin + sideways * cos], axis=-1)
    reach = np.sqrt((outline**2).sum(axis=-1)).max()
    return np.asarray(outline * (radius / reach))


def _faces(index: Int32Array) -> Int32Array:
    """Return the triangles of tubes of (strands, rows, ring) vertices, closed by flat caps."""
    after = np.roll(index, -1, axis=2)
    wall = quads(index[:, :-1], after[:, :-1], after[:, 1:], index[:, 1:])
    first, last = index[:, 0], index[:, -1]
    start = np.stack(
        [np.broadcast_to(first[:, :1], first[:, 2:].shape), first[:, 2:], first[:, 1:-1]], axis=-1
    )
    end = np.stack(
        [np.broadcast_to(last[:, :1], last[:, 2:].shape), last[:, 1:-1], last[:, 2:]], axis=-1
    )
    return np.concatenate([each.reshape(-1, 3) for each in (wall, start, end)]).astype(np.int32)


def _outer(sections: FloatArray) -> BoolArray:
    """Return which vertices see the outside: no edge of any strand crosses their outward ray."""
    strands, rows, ring, _ = sections.shape
    points = sections.transpose(1, 0, 2, 3).reshape(rows, strands * ring, 2)
    starts = points
    ends = np.roll(sections, -1, axis=2).transpose(1, 0, 2, 3).reshape(rows, strands * ring, 2)
    outer = np.empty((rows, strands * ring), dtype=bool)
    for row in range(rows):
        p, a, b = points[row], starts[row], ends[row]
        reach = np.sqrt((p**2).sum(axis=1))
        ray = p / reach[:, None]
        # Side of each edge's ends with respect to each ray; a crossing changes side.
        side_a = ray[:, None, 0] * a[None, :, 1] - ray[:, None, 1] * a[None, :, 0]
        side_b = ray[:, None, 0] * b[None, :, 1] - ray[:, None, 1] * b[None, :, 0]
        # A corner exactly on the ray counts to one side, so that one of its edges is crossed.
        crosses = (side_a < 0) != (side_b < 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = side_a / (side_a - side_b)
            met = a[None] + share[..., None] * (b - a)[None]
            distance = (met * ray[:, None]).sum(axis=-1)
        beyond = crosses & (distance > reach[:, None] * (1.0 + 1e-6))
        # The edges that meet in the vertex itself touch the ray but are not beyond it.
        outer[row] = ~beyond.any(axis=1)
    return outer.reshape(rows, strands, ring).transpose(1, 0, 2)


def ball_mesh(radius_m: float) -> tuple[FloatArray, Int32Array]:
    """Return a sphere around the origin, its poles on the rope's axis.

    Args:
        radius_m: Radius, metres.

    Returns:
        float64 (V, 3) rest positions, metres (first axis along the rope, from the ball into
        it), and int32 (F, 3) triangles, outward winding.
    """
    around = 2 * _RINGS
    polar = math.pi * np.arange(1, _RINGS) / _RINGS
    azimuth = 2.0 * math.pi * np.arange(around) / around
    body = np.stack(
        [
            np.broadcast_to(portable.cos(polar)[:, None], (_RINGS - 1, around)),
            portable.sin(polar)[:, None] * portable.cos(azimuth),
            portable.sin(polar)[:, None] * portable.sin(azimuth),
        ],
        axis=-1,
    ).reshape(-1, 3)
    rest = radius_m * np.concatenate([[[1.0, 0.0, 0.0]], body, [[-1.0, 0.0, 0.0]]])
    index = 1 + np.arange((_RINGS - 1) * around).reshape(_RINGS - 1, around)
    after = np.roll(index, -1, axis=1)
    wall = quads(index[:-1], index[1:], after[1:], after[:-1])
    last = len(rest) - 1
    first_cap = np.stack([np.zeros(around, int), index[0], after[0]], axis=-1)
    last_cap = np.stack([index[-1], np.full(around, last), after[-1]], axis=-1)
    faces = np.concatenate([wall, first_cap, last_cap]).astype(np.int32)
    return rest, faces


def ball_chart(rest: FloatArray) -> FloatArray:
    """Return the material coordinates of the ball: polar angle and azimuth, radians.

    Args:
        rest: float64 (N, 3).

    Returns:
        float64 (N, 2): 0..pi from the pole in the rope, and -pi..pi around it.
    """
    radial = np.sqrt(rest[:, 1] ** 2 + rest[:, 2] ** 2)
    return np.stack(
        [portable.arctan2(radial, rest[:, 0]), portable.arctan2(rest[:, 2], rest[:, 1])], axis=1
    )


def place_ball(rest: FloatArray, centre: FloatArray, frame: FloatArray) -> FloatArray:
    """Return the ball's vertices in the world.

    Args:
        rest: float64 (V, 3), metres.
        centre: float64 (3,), metres.
        frame: float64 (3, 3): tangent, normal, binormal of the rope's first point.

    Returns:
        float64 (V, 3), metres.
    """
    # Written out: a product of matrices may round differently on another machine.
    return np.asarray(
        centre + rest[:, 0:1] * frame[0] + rest[:, 1:2] * frame[1] + rest[:, 2:3] * frame[2]
    )
