"""A centre line made into the geometry of one frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from pliant.generator.objects.rope.ball import ball_chart, ball_mesh, place_ball
from pliant.generator.objects.rope.contact import crossings
from pliant.generator.objects.rope.curve import resample, twist_free_frames
from pliant.generator.objects.rope.mesh import bend, rope_chart, rope_mesh
from pliant.generator.objects.rope.points import rope_points
from pliant.generator.objects.rope.tier import BALL_ID, ROPE_ID
from pliant.generator.scene.scene_object import FloatArray, Part, Pose
from pliant.generator.settings.rope import RopeSettings


class RopeBody:
    """The parts and points of a rope, and its surface along any centre line.

    Attributes:
        settings: The tier's settings.
        parts: The rope, then the ball if there is one.
        points: The named material points.
    """

    def __init__(self, settings: RopeSettings) -> None:
        self.settings = settings
        self._mesh = rope_mesh(settings)
        self.points = rope_points(settings, self._mesh)
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
        facts = {**info, "crossings": [each.as_dict() for each in crossings(centreline)]}
        return Pose(vertices=vertices, centreline=line, info=facts)


def upward_normal(centreline: FloatArray, roll_rad: float) -> FloatArray:
    """Return the upward direction at the rope's first point, rolled about the rope.

    Args:
        centreline: float64 (n, 3), metres; its first step must not be vertical.
        roll_rad: Angle, radians.

    Returns:
        float64 (3,), a unit vector at right angles to the first step.
    """
    tangent = centreline[1] - centreline[0]
    tangent = tangent / math.sqrt(float((tangent**2).sum()))
    up = np.array([0.0, 0.0, 1.0]) - tangent[2] * tangent
    up /= math.sqrt(float((up**2).sum()))
    return np.asarray(math.cos(roll_rad) * up + math.sin(roll_rad) * np.cross(tangent, up))
