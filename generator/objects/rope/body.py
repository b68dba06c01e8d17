"""The body of a rope: parts, named material points, and the geometry along any centre line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.generator import portable
from pliant.generator.objects.rope.contact import crossings
from pliant.generator.objects.rope.curve import first_direction, resample, twist_free_frames
from pliant.generator.objects.rope.mesh import (
    RopeMesh,
    ball_chart,
    ball_mesh,
    bend,
    place_ball,
    rope_chart,
    rope_mesh,
)
from pliant.generator.scene.scene_object import Part, Points, Pose
from pliant.generator.settings.rope import RopeSettings
from pliant.spec.arrays import FloatArray

ROPE_ID: Final = 1
BALL_ID: Final = 2


class RopeBody:
    """The parts and points of a rope, and its surface along any centre line.

    Attributes:
        settings: The tier's settings.
        parts: The rope, then the ball if there is one.
        points: The named material points.
    """

    def __init__(self, settings: RopeSettings, *, same_points: bool = False) -> None:
        """Make the body.

        Args:
            settings: The rope's settings, of drawn proportions where the tier's are ranges.
            same_points: Name the material points that ropes of all proportions have, instead of
                vertices of this mesh.
        """
        self.settings = settings
        self._mesh = rope_mesh(settings)
        self.points = rope_points(settings, self._mesh, same_points)
        rope = Part(
            object_id=ROPE_ID,
            name="rope",
            faces=self._mesh.faces,
            rest=self._mesh.rest,
            chart=rope_chart(settings.length_m),
            strand=self._mesh.strand,
        )
        self.parts: tuple[Part, ...] = (rope,)
        if settings.ball:
            rest, faces = ball_mesh(settings.ball_radius_m)
            ball = Part(
                object_id=BALL_ID,
                name="ball",
                faces=faces,
                rest=rest,
                chart=ball_chart,
                strand=np.zeros(len(rest), dtype=np.int32),
            )
            self.parts = (rope, ball)

    def pose(
        self,
        centreline: FloatArray,
        normal: FloatArray,
        ball_centre: FloatArray | None,
        info: Mapping[str, Any],
    ) -> Pose:
        """Return the geometry of a frame.

        Args:
            centreline: float64 (rows, 3), metres, equal arc length.
            normal: float64 (3,), direction of theta = 0 at s = 0.
            ball_centre: float64 (3,), metres, or None without a ball.
            info: Facts of the frame; its crossings are added.

        Returns:
            The pose; its centre line is sampled at the tier's centre-line points.
        """
        frames = twist_free_frames(centreline, normal)
        vertices = {"rope": bend(self._mesh, centreline, frames)}
        if ball_centre is not None:
            vertices["ball"] = place_ball(self.parts[1].rest, ball_centre, frames[0])
        line = resample(centreline, self.settings.centreline_points)
        facts = {**info, "crossings": crossings(centreline)}
        return Pose(vertices=vertices, centreline=line, info=facts)


def upward_normal(centreline: FloatArray, roll_rad: float) -> FloatArray:
    """Return the upward direction at the rope's first point, rolled about the rope.

    Args:
        centreline: float64 (n, 3), metres; its first step must not be vertical.
        roll_rad: Angle, radians.

    Returns:
        float64 (3,), a unit vector at right angles to the first step.
    """
    tangent = first_direction(centreline)
    up = np.array([0.0, 0.0, 1.0]) - tangent[2] * tangent
    up /= portable.norm(up)
    return np.asarray(math.cos(roll_rad) * up + math.sin(roll_rad) * np.cross(tangent, up))


def rope_points(settings: RopeSettings, mesh: RopeMesh, same_points: bool = False) -> Points:
    """Return surface points on evenly spaced cross sections, then points on the centre line.

    Half of the stations are chosen and the other half are their mirror images, so that the
    reversal maps points onto points.

    Args:
        settings: How many stations, angles and centre-line points.
        mesh: The straight rope.
        same_points: Put the points at material coordinates that depend on neither radius, length,
            strands nor turns.

    Returns:
        The points. `partners` has one column without the ball and none with it.
    """
    half = settings.point_stations // 2
    rows = np.unique(
        np.floor((np.arange(half) + 0.5) * settings.rows / settings.point_stations).astype(int)
    )
    choose = _at_angles if same_points else _around
    chosen = [choose(mesh, int(row), settings.point_angles) for row in rows]
    first = np.concatenate(chosen)
    # Station k from the front is mirrored by station k from the back; within one, in order.
    ids = np.arange(len(first))
    mirrored = np.concatenate(np.split(ids, np.cumsum([len(each) for each in chosen]))[::-1])
    second = first[mirrored]
    second["vertex"], second["other"] = mesh.mirror[second["vertex"]], mesh.mirror[second["other"]]
    edges = np.concatenate([first, second])
    vertex, other = edges["vertex"], edges["other"]
    partner = np.concatenate([len(first) + np.argsort(mirrored), mirrored])

    count = settings.centreline_points
    along = np.linspace(0.0, 1.0, count)
    share = edges["share"]
    rest = (1.0 - share[:, None]) * mesh.rest[vertex] + share[:, None] * mesh.rest[other]
    surface_material = rope_chart(settings.length_m)(rest)
    if same_points:  # to the last bit: not as this rope's mesh rounds them
        surface_material = np.round(surface_material, 9)
    line_material = np.stack([along, np.zeros(count)], axis=1)
    line_partner = len(vertex) + np.arange(count)[::-1]
    partners = np.concatenate([partner, line_partner])[:, None]
    if settings.ball:
        partners = partners[:, :0]
    total = len(vertex) + count
    return Points(
        object_id=np.full(total, ROPE_ID, dtype=np.int32),
        vertex=np.concatenate([vertex, np.arange(count)]).astype(np.int32),
        centreline=np.arange(total) >= len(vertex),
        material=np.concatenate([surface_material, line_material]).astype(np.float32),
        partners=partners.astype(np.int32),
        other=np.concatenate([other, np.arange(count)]).astype(np.int32),
        share=np.concatenate([share, np.zeros(count)]),
    )


_EDGES: Final = np.dtype([("vertex", np.int32), ("other", np.int32), ("share", np.float64)])
"""Places on edges between two vertices; twice the same vertex is that vertex."""


def _around(mesh: RopeMesh, row: int, angles: int) -> npt.NDArray[np.void]:
    """Return the outer vertices of a cross section nearest to evenly spaced angles."""
    candidates = np.flatnonzero((mesh.row == row) & mesh.outer)
    theta = portable.arctan2(mesh.rest[candidates, 2], mesh.rest[candidates, 1])
    free = np.ones(len(candidates), dtype=bool)
    picked = []
    for k in range(min(angles, len(candidates))):
        off = np.abs((theta - 2.0 * math.pi * k / angles + math.pi) % (2.0 * math.pi) - math.pi)
        best = int(np.argmin(np.where(free, off, np.inf)))
        free[best] = False
        picked.append((candidates[best], candidates[best], 0.0))
    return np.array(picked, _EDGES)


def _at_angles(mesh: RopeMesh, row: int, angles: int) -> npt.NDArray[np.void]:
    """Return the outermost places of a cross section at evenly spaced angles, on its edges."""
    here = np.flatnonzero(mesh.row == row)
    after = np.concatenate(
        [np.roll(here[mesh.strand[here] == strand], -1) for strand in np.unique(mesh.strand)]
    )
    a, b = mesh.rest[here, 1:], mesh.rest[after, 1:]
    # A quarter step off: no angle is at the seam, where rounding would decide its sign.
    theta = 2.0 * math.pi * (np.arange(angles)[:, None] + 0.25) / angles
    x, y = portable.cos(theta), portable.sin(theta)
    side_a, side_b = x * a[:, 1] - y * a[:, 0], x * b[:, 1] - y * b[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = side_a / (side_a - side_b)
    reach = x * ((1 - share) * a[:, 0] + share * b[:, 0])
    reach += y * ((1 - share) * a[:, 1] + share * b[:, 1])
    best = np.where((side_a < 0) != (side_b < 0), reach, -np.inf).argmax(axis=1)
    found = np.empty(angles, _EDGES)
    found["vertex"], found["other"] = here[best], after[best]
    found["share"] = share[np.arange(angles), best]
    return found
