"""From the masses of a simulation to the rendered surface, placed in the world and measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pliant.generator.objects.cloth.grid import corner_vertices, grid_mesh
from pliant.generator.objects.cloth.measure import Cover, measure_cover
from pliant.generator.objects.cloth.subdivision import subdivide
from pliant.generator.settings.cloth import ClothSettings

FloatArray = npt.NDArray[np.float64]

PART = "cloth"


@dataclass(frozen=True)
class Placement:
    """Where a simulated cloth stands in the world: turned about the vertical, then shifted.

    Attributes:
        yaw_rad: Angle of the turn.
        shift_m: (x, y), added after the turn.
    """

    yaw_rad: float
    shift_m: tuple[float, float]

    @classmethod
    def centred(cls, positions: FloatArray, yaw_rad: float) -> Placement:
        """Return the placement that puts the middle of the cloth's box over the origin."""
        turned = cls(yaw_rad, (0.0, 0.0)).apply(positions)
        middle = 0.5 * (turned.min(axis=0) + turned.max(axis=0))
        return cls(yaw_rad, (-float(middle[0]), -float(middle[1])))

    def apply(self, positions: FloatArray) -> FloatArray:
        """Return positions (float64 (N, 3), metres) in the world."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        placed = positions @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        placed[:, :2] += self.shift_m
        return placed


def render_vertices(settings: ClothSettings, positions: FloatArray) -> tuple[FloatArray, int]:
    """Return the rendered grid through the masses, and how often it pokes through itself.

    Args:
        settings: The tier's settings.
        positions: float64 (points_a_side², 3), masses in the world, metres.

    Returns:
        float64 (render_a_side², 3), metres, and the number of edges that pierce a triangle.
    """
    side = settings.points_a_side
    return subdivide(
        positions,
        side,
        side,
        settings.doublings,
        0.5 * settings.thickness_m,
        settings.smoothing,
    )


def cover_of(settings: ClothSettings, vertices: FloatArray) -> Cover:
    """Return what the rendered surface shows from above."""
    side = settings.render_a_side
    return measure_cover(
        vertices, grid_mesh(side, side)[0], corner_vertices(side, side), settings.side_m
    )
